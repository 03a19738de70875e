"""Self-contained HTML pages: no script, no network, the same bytes from the same values.

``render`` fills a template of ``templates/``, ``picture`` makes an array a picture with a scale bar.
"""

from mapgraft.pages.document import prepare, readable, render
from mapgraft.pages.pictures import Picture, bar_m, data_uri, picture, png, png_uri

__all__ = ["Picture", "bar_m", "data_uri", "picture", "png", "png_uri", "prepare", "readable", "render"]
