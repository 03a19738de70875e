"""Rows of numbers in text."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SHOWN = 40


def numbers_in(text: bytes, rows: int, columns: int) -> NDArray[np.float64]:
    """The first ``rows`` × ``columns`` numbers of a text, ``nan`` and ``inf`` among them.

    Raises ValueError where there are fewer, or where something is no number.
    """
    words = text.split(maxsplit=rows * columns) if rows * columns else []
    words = words[: rows * columns]
    if len(words) < rows * columns:
        raise ValueError(f"it needs {rows} rows of {columns} numbers, has {len(words)} numbers")
    try:
        return np.array(words).astype(np.float64).reshape(rows, columns)
    except ValueError:
        wrong = next(word for word in words if not _is_number(word))
        raise ValueError(f"{wrong[:_SHOWN].decode(errors='replace')!r} is no number") from None


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
