"""mapgraft: graft the maps of several robots into each other, verify, and take a wrong graft out again.

``mapgraft.run(files, config, out)`` is the main job; ``mapgraft.contracts`` is all that a plugin needs.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mapgraft.job import Result, run

__version__ = "0.1.0"
__all__ = ["Result", "__version__", "run"]


def __getattr__(name: str) -> Any:
    """Import the main job when it is asked for, so that ``import mapgraft`` costs nothing."""
    if name in ("Result", "run"):
        from mapgraft import job

        return getattr(job, name)
    raise AttributeError(f"module 'mapgraft' has no attribute {name!r}")
