"""Merge attempts as examples that persons label, thresholds are learned from, and others can use.

``ExampleFolder`` reads what ``run``, ``evaluate`` and ``dataset`` have written, and what people say of it.
"""

from mapgraft.examples.reading import (
    ExampleFolder,
    ExampleKey,
    Word,
    last_words,
    last_words_on,
    published_words,
    put_at,
    transform_of,
)

__all__ = [
    "ExampleFolder",
    "ExampleKey",
    "Word",
    "last_words",
    "last_words_on",
    "published_words",
    "put_at",
    "transform_of",
]
