"""Self-contained HTML pages: no script, no network, the same bytes from the same values.

``render`` fills a template of ``templates/``, ``picture`` makes an array a picture with a scale bar, and ``drawing``
with ``svg`` makes a matplotlib figure part of a page.
"""

from mapgraft.pages.charts import SERIES, drawing, svg
from mapgraft.pages.document import readable, render
from mapgraft.pages.pictures import Picture, picture, png, png_uri

__all__ = ["SERIES", "Picture", "drawing", "picture", "png", "png_uri", "readable", "render", "svg"]
