"""What robots tell each other of their merges: claims, and the join by which all who heard the same know the same."""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final, Literal, NamedTuple

import numpy as np

from mapgraft.contracts import Covariance, MapError, Transform, TransformError
from mapgraft.contracts.geometry import ROTATION_STEP, TRANSLATION_STEP_M

State = Literal["provisional", "confirmed", "reverted"]

RANK: Final[Mapping[State, int]] = {"provisional": 0, "confirmed": 1, "reverted": 2}
MOST_SUPPORT: Final = 12.0  # nats: nobody is surer than that, either way
MOST_NAME_BYTES: Final = 400  # a robot's name of 100 letters
MOST_TEXT_BYTES: Final = 1000
PERSON: Final = "person"  # who decided, where that was no robot
MOST_COUNTED: Final = 1 << 32  # corrections of one map
REMEMBERED: Final = 4096  # claims that were read: in one process many robots hear the same
_STATES: Final[tuple[State, ...]] = ("provisional", "confirmed", "reverted")
_MAGIC: Final = b"MGC1"
_FIXED: Final = struct.Struct("<IBIq9i3qddB")  # epoch, state, revision, stamp, rotation, shift, scale, support, has
_HAS_COVARIANCE: Final = 1
_HAS_CORRECTIONS: Final = 2
_CORRECTIONS: Final = struct.Struct("<II")
_EPOCH: Final = struct.Struct("<I")
_LENGTH: Final = struct.Struct("<H")
_UPPER: Final = np.triu_indices(6)
_MOST_SCALE: Final = 1e6
_NOT_NEGATIVE: Final = -1e-6  # of the largest eigenvalue: rounding


class Source(NamedTuple):
    """One map frame's life: a robot that starts again with another frame is another source of the same name."""

    name: str
    epoch: int


class Edge(NamedTuple):
    """What a claim is about: the donor's map in the receiver's. Only the receiver merges, so only it writes."""

    receiver: Source
    donor: Source


@dataclass(frozen=True, slots=True, eq=False)
class Claim:
    """What the receiver says of one merge it made.

    ``epoch`` is the n of the merge id, so that merging again after a revert is a new epoch, which what is told late of
    the older one cannot undo; it is more where another robot of the same name has told of merges, too. ``revision``
    rises with every change within it. ``T_receiver_donor`` is in fixed point, ``covariance`` in the receiver's frame,
    to first order, None where nobody knows. ``support`` is the log-odds (nats) that the merge is right, as the receiver
    judges now, within ±12. ``stamp_ns`` is data time, ``by`` who decided. ``corrections`` tells how often the
    receiver's and the donor's maps had been corrected when the transform was found.
    The donor may write ``reverted`` of an epoch, too, and nobody else may write anything.
    """

    receiver: Source
    donor: Source
    epoch: int
    state: State
    revision: int
    T_receiver_donor: Transform
    scale: float = 1.0
    covariance: Covariance | None = None
    support: float = 0.0
    stamp_ns: int = 0
    by: str = ""
    reason: str = ""
    corrections: tuple[int, int] = (0, 0)
    data: bytes = field(init=False, repr=False)
    edge: Edge = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Make it canonical: fixed point, support within bounds and in thousandths, texts of bounded length."""
        put = object.__setattr__
        put(self, "T_receiver_donor", self.T_receiver_donor.snapped())
        put(self, "support", round(1000.0 * max(-MOST_SUPPORT, min(MOST_SUPPORT, self.support))) / 1000.0 + 0.0)
        put(self, "by", _shortened(self.by))
        put(self, "reason", _shortened(self.reason))
        if self.covariance is not None:
            symmetric = (self.covariance + self.covariance.T) / 2.0 + 0.0
            symmetric.setflags(write=False)
            put(self, "covariance", symmetric)
        put(self, "edge", Edge(self.receiver, self.donor))
        put(self, "data", self._encoded())

    @property
    def merge_id(self) -> str:
        """The id that the merge has in the receiver's history, if nobody else has told of merges under its name."""
        return f"{self.receiver.name}.{self.donor.name}.{self.epoch}"

    @property
    def is_active(self) -> bool:
        """Whether the merge stands."""
        return self.state != "reverted"

    @property
    def is_decided(self) -> bool:
        """Whether a person said that the merge is right: no robot takes it back."""
        return self.is_active and self.by == PERSON

    def corrections_of(self, end: Source) -> int:
        """How often the map of one of its two ends had been corrected when the transform was found."""
        return self.corrections[0 if end == self.receiver else 1]

    def encode(self) -> bytes:
        """Canonical bytes: equal claims, equal bytes."""
        return self.data

    def _encoded(self) -> bytes:
        matrix = self.T_receiver_donor.matrix
        has = _HAS_COVARIANCE if self.covariance is not None else 0
        has |= _HAS_CORRECTIONS if any(self.corrections) else 0
        fixed = _FIXED.pack(
            self.epoch,
            RANK[self.state],
            self.revision,
            self.stamp_ns,
            *(round(float(value) / ROTATION_STEP) for value in matrix[:3, :3].flat),
            *(round(float(value) / TRANSLATION_STEP_M) for value in matrix[:3, 3]),
            self.scale,
            self.support,
            has,
        )
        sigma = b"" if self.covariance is None else self.covariance[_UPPER].astype("<f8").tobytes()
        corrections = _CORRECTIONS.pack(*self.corrections) if any(self.corrections) else b""
        names = b"".join(_text(one.name) + _EPOCH.pack(one.epoch) for one in self.edge)
        return _MAGIC + names + fixed + sigma + corrections + _text(self.by) + _text(self.reason)

    @classmethod
    def decode(cls, data: bytes) -> Claim:
        """The claim in the bytes, the same object for the same bytes as long as few others were read.

        Raises MapError when the bytes are not the canonical bytes of a claim that can be true.
        """
        return _decoded(bytes(data))

    @property
    def order(self) -> tuple[int, bool, int, int, int, bytes]:
        """What decides which of two claims about one edge holds: the larger one.

        What is told of a merge after one of its maps was corrected goes before all that was told before.
        """
        told = (sum(self.corrections), RANK[self.state], self.revision)
        return self.epoch, not self.is_active, *told, hashlib.sha256(self.data).digest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Claim) and self.data == other.data

    def __hash__(self) -> int:
        return hash(self.data)


class Claims:
    """What one robot has heard of merges, its own among them: of each edge the claim that holds.

    A join-semilattice: whatever the order in which claims come, and however often, the same ones make the same state.
    """

    __slots__ = ("_by_edge", "_changed", "_digest", "version")

    def __init__(self, claims: Iterable[Claim] = ()) -> None:
        self._by_edge: dict[Edge, Claim] = {}
        self._changed: dict[Edge, int] = {}  # at which version the claim came that holds, the latest last
        self._digest: bytes | None = None
        self.version = 0  # rises with every change
        for claim in claims:
            self.add(claim)

    def add(self, claim: Claim) -> bool:
        """Take a claim in; True when it changes anything."""
        known = self._by_edge.get(claim.edge)
        if known is not None and claim.order <= known.order:
            return False
        self._by_edge[claim.edge] = claim
        self._digest = None
        self.version += 1
        self._changed.pop(claim.edge, None)
        self._changed[claim.edge] = self.version
        return True

    def join(self, claims: Iterable[Claim]) -> list[Claim]:
        """Take in all of them; returns those that changed anything."""
        return [claim for claim in claims if self.add(claim)]

    def of(self, receiver: Source, donor: Source) -> Claim | None:
        """The claim about one edge."""
        return self._by_edge.get(Edge(receiver, donor))

    def active(self) -> tuple[Claim, ...]:
        """Those of merges that stand, in the order of their edges."""
        return tuple(claim for claim in self if claim.is_active)

    def since(self, version: int) -> Iterator[Claim]:
        """Those that hold now and did not yet at a version, the latest first; what is older costs nothing."""
        for edge in reversed(self._changed):
            if self._changed[edge] <= version:
                return
            yield self._by_edge[edge]

    def digest(self) -> bytes:
        """32 bytes that are equal where the claims are."""
        if self._digest is None:
            whole = hashlib.sha256()
            for claim in self:
                whole.update(len(claim.data).to_bytes(4, "little") + claim.data)
            self._digest = whole.digest()
        return self._digest

    def __iter__(self) -> Iterator[Claim]:
        """In the order of their edges, whatever the order in which they came."""
        return iter([self._by_edge[edge] for edge in sorted(self._by_edge)])

    def __len__(self) -> int:
        return len(self._by_edge)


def _text(text: str) -> bytes:
    data = text.encode()
    return _LENGTH.pack(len(data)) + data


def _shortened(text: str) -> str:
    """Not longer than what travels, cut between letters."""
    return text.encode(errors="replace")[:MOST_TEXT_BYTES].decode(errors="ignore")


@lru_cache(maxsize=REMEMBERED)
def _decoded(data: bytes) -> Claim:
    try:
        claim = _read(data)
        if claim.data != data:
            raise ValueError("it is not written as claims are")
        _check(claim)
    except (ValueError, struct.error, TransformError, OverflowError) as error:
        raise MapError(f"a claim of {len(data)} bytes cannot be read: {error}") from None
    return claim


def _read(data: bytes) -> Claim:
    """The claim in some bytes; raises ValueError and struct.error where there is none."""
    if data[:4] != _MAGIC:
        raise ValueError(f"it starts with {data[:4]!r}")
    at, sources = 4, []
    for _ in range(2):
        name, at = _read_text(data, at, MOST_NAME_BYTES)
        sources.append(Source(name, *_EPOCH.unpack_from(data, at)))
        at += _EPOCH.size
    epoch, state, revision, stamp_ns, *rest = _FIXED.unpack_from(data, at)
    at += _FIXED.size
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(rest[:9], (3, 3)) * ROTATION_STEP
    matrix[:3, 3] = np.array(rest[9:12]) * TRANSLATION_STEP_M
    scale, support, has = rest[12:]
    covariance: Covariance | None = None
    if has & _HAS_COVARIANCE:
        if len(data) < at + 168:
            raise ValueError("its covariance is cut short")
        covariance = np.zeros((6, 6))
        covariance[_UPPER] = np.frombuffer(data, "<f8", 21, at)
        covariance = covariance + np.triu(covariance, 1).T
        at += 168
    corrections = (0, 0)
    if has & _HAS_CORRECTIONS:
        corrections = _CORRECTIONS.unpack_from(data, at)
        at += _CORRECTIONS.size
    by, at = _read_text(data, at, MOST_TEXT_BYTES)
    reason, at = _read_text(data, at, MOST_TEXT_BYTES)
    if at != len(data) or state >= len(_STATES):
        raise ValueError("it has no known state, or something behind its end")
    T = Transform.from_matrix(matrix)
    if not (math.isfinite(support) and math.isfinite(scale)):
        raise ValueError(f"its support is {support} and its scale {scale}")
    made = (sources[0], sources[1], epoch, _STATES[state], revision, T, scale, covariance)
    return Claim(*made, support, stamp_ns, by, reason, corrections)


def _read_text(data: bytes, at: int, most: int) -> tuple[str, int]:
    (length,) = _LENGTH.unpack_from(data, at)
    start = at + _LENGTH.size
    if length > most or start + length > len(data):
        raise ValueError(f"it has a text of {length} bytes")
    return data[start : start + length].decode(), start + length


def _check(claim: Claim) -> None:
    """Raises ValueError when a claim cannot be true."""
    if claim.receiver == claim.donor or not (claim.receiver.name and claim.donor.name):
        raise ValueError(f"{claim.receiver} cannot merge {claim.donor}")
    if not 1.0 / _MOST_SCALE <= claim.scale <= _MOST_SCALE:
        raise ValueError(f"its scale is {claim.scale:g}")
    if claim.covariance is not None and not is_covariance(claim.covariance):
        raise ValueError("its covariance is none: it is not finite, or has a negative eigenvalue")


def is_covariance(matrix: Covariance) -> bool:
    """Whether a symmetric (6, 6) matrix is finite and without negative eigenvalues, but for rounding."""
    if not np.isfinite(matrix).all():
        return False
    eigenvalues = np.linalg.eigvalsh(matrix)
    return bool(eigenvalues[0] >= _NOT_NEGATIVE * max(eigenvalues[-1], 1e-12))
