"""Pages from templates, with everything that comes from outside escaped."""

from __future__ import annotations

import unicodedata
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment

PACKAGE = "mapgraft.pages"
_REPLACEMENT = "\N{REPLACEMENT CHARACTER}"
_HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn")  # control, invisible and direction-changing characters, and no characters


def render(template: str, package: str = PACKAGE, /, **values: object) -> str:
    """The page of a template in the folder ``templates/`` of a package; pages of this one extend ``base.html``.

    Values are escaped wherever they are put, also in attributes; what may be markup is a ``markupsafe.Markup``. A value
    that a template asks for and does not get raises jinja2.UndefinedError.
    """
    return _environment(package).get_template(template).render(**values)


def prepare(package: str = PACKAGE) -> None:
    """Compile the templates of a package, so that its first page comes as fast as any other."""
    environment = _environment(package)
    for name in environment.list_templates(extensions=["html"]):
        environment.get_template(name)


def readable(text: str) -> str:
    """The text with what a person cannot see replaced: control characters, and those that turn the direction of text.

    Names come from recordings; one must not make a line of a page say something else. Soft hyphens and joiners that
    scripts and emoji need go, too.
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(c if c in "\n\t" or unicodedata.category(c) not in _HIDDEN else _REPLACEMENT for c in text)


@cache
def _environment(package: str) -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    def shown(value: object) -> object:
        if isinstance(value, str) and not isinstance(value, Markup):
            return readable(value)
        return "" if value is None else value

    return Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
