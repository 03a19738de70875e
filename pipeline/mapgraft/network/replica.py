"""What one robot holds of all sources: layers and previews by part and version, bounded in what strangers send."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final, NamedTuple

from mapgraft.contracts import MapError
from mapgraft.exchange import Form
from mapgraft.graph.claims import Source
from mapgraft.network.held import Held, Taken, messages_of, raw
from mapgraft.network.wire import ASPECTS, WRITER, Copy, Head, Parts, Piece, Want

MOST_COPIES: Final = 4096


class Whole(NamedTuple):
    """One complete version: what its writer said of it, and what gives its parts as the map type cut them."""

    head: Head
    parts: Callable[[], Mapping[bytes, bytes]]


@dataclass(slots=True)
class Replica:
    """The copies of one robot, its own among them. Which is newer is decided in one place: ``Held``."""

    copies: dict[Copy, Held] = field(default_factory=dict)

    def publish(self, copy: Copy, writer: bytes, offer: bytes, version: int, form: Form,
                parts: Mapping[bytes, bytes]) -> None:  # fmt: skip
        """Put in a version of one's own."""
        self._of(copy).publish(writer, offer, version, form, parts)

    def take(self, copy: Copy, head: Head, pieces: tuple[Piece, ...]) -> Taken:
        """Take in what came; raises MapError when it cannot be what it is said to be."""
        return self._of(copy).take(head, pieces)

    def version(self, copy: Copy) -> int:
        """The last version that is complete here; 0 where none is."""
        held = self.copies.get(copy)
        return 0 if held is None else held.version

    def head(self, copy: Copy) -> Head | None:
        """What the writer said of the last complete version."""
        held = self.copies.get(copy)
        return None if held is None else held.whole

    def whole(self, copy: Copy) -> Whole | None:
        """The last complete version; None where there is none. It stays what it is when newer ones come."""
        held = self.copies.get(copy)
        return None if held is None or held.whole is None else Whole(held.whole, partial(raw, held.whole_parts))

    def conflict(self, copy: Copy) -> str:
        """Why nothing more is taken of a copy; empty while something is."""
        held = self.copies.get(copy)
        return "" if held is None else held.conflict

    def wish(self, copy: Copy, plain: bool = False, writer: bytes = bytes(WRITER)) -> Want:
        """What to ask for to get the newest version of a copy; what has come already is left out, as far as it fits.

        ``writer`` is whose it is as far as is known, where nothing is held.
        """
        held = self.copies.get(copy)
        if held is None or held.head is None:
            return Want(copy, 0, writer, plain)
        got = {} if plain else dict(sorted(held.got().items())[:_MOST_GOT])
        return Want(copy, held.version, held.head.writer, plain, got)

    def belongs_to(self, source: Source, writer: bytes) -> None:
        """A source is that writer's: what is held of it by one of a larger id was another robot's of that name."""
        for aspect in ASPECTS:
            held = self.copies.get(Copy(source, aspect))
            if held is not None and held.head is not None and held.head.writer > writer:
                del self.copies[Copy(source, aspect)]

    def start_anew(self, copy: Copy) -> None:
        """Forget what came of a copy since it was last complete."""
        if (held := self.copies.get(copy)) is not None:
            held.start_anew()

    def answer(self, want: Want) -> list[Parts]:
        """The messages that bring whoever asks to what is complete here; one without a head where nothing is newer."""
        held = self.copies.get(want.copy)
        nothing = [Parts(want.copy, want.since)]
        if held is None or held.whole is None:
            return nothing
        since, got = want.since, want.got
        if want.writer != held.whole.writer:
            if any(want.writer) and want.writer < held.whole.writer:
                return nothing
            since, got = 0, {}
        elif held.version <= since:
            return nothing
        told = messages_of(held.pieces(since, got, want.plain))
        return [Parts(want.copy, since, held.whole, number, len(told), pieces) for number, pieces in enumerate(told)]

    def _of(self, copy: Copy) -> Held:
        held = self.copies.get(copy)
        if held is None:
            if len(self.copies) >= MOST_COPIES:
                raise MapError(f"there are copies of {MOST_COPIES} layers already: more are not kept")
            held = self.copies[copy] = Held()
        return held


_MOST_GOT: Final = 400  # names of at most 72 bytes in one question
