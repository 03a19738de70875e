"""What a nasty input is, and what several kinds of them have in common."""

from __future__ import annotations

from dataclasses import dataclass

S = 1_000_000_000
LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 9)
)


@dataclass(frozen=True)
class Nasty:
    """One input: files by name, the words of the command line (``@`` stands for the folder), and what to look for.

    ``hint`` picks the line of the output that is expected where the command does its work all the same.
    """

    name: str
    files: dict[str, bytes]
    command: tuple[str, ...]
    hint: str = ""
    folders: tuple[str, ...] = ()


def patched(data: bytes, offset: int, value: bytes) -> bytes:
    """Some bytes in the place of others."""
    return data[:offset] + value + data[offset + len(value) :]
