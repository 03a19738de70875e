"""Many missions and configurations as jobs on any executor, into one data set on a disk or an object store."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mapgraft.corpus.dataset import Dataset
    from mapgraft.corpus.document import read_plan
    from mapgraft.corpus.executors import executor_of
    from mapgraft.corpus.plan import Job
    from mapgraft.corpus.running import Report, run_corpus

__all__ = ["Dataset", "Job", "Report", "executor_of", "read_plan", "run_corpus"]
_WHERE = {
    "Dataset": "dataset",
    "Job": "plan",
    "Report": "running",
    "executor_of": "executors",
    "read_plan": "document",
    "run_corpus": "running",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is: a process that shares the work sets its threads before numpy is loaded."""
    if name in _WHERE:
        from importlib import import_module

        return getattr(import_module(f"mapgraft.corpus.{_WHERE[name]}"), name)
    raise AttributeError(f"module 'mapgraft.corpus' has no attribute {name!r}")
