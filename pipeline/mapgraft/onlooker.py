"""Who looks on while robots make attempts sees more of them than the events tell, and never answers back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from mapgraft.contracts import Donation, MapMetadata, MapType, Sample, Verdict

if TYPE_CHECKING:
    from mapgraft.attempt import Attempt
    from mapgraft.procedures import Tools
    from mapgraft.reversal import Reversal


@dataclass(frozen=True, slots=True, eq=False)
class Encountered:
    """What a receiver and a donor tell of their maps before an attempt; ``reversal`` holds the receiver's map."""

    receiver: str
    donor: str
    map_type: MapType
    reversal: Reversal
    own: MapMetadata
    other: MapMetadata


@dataclass(frozen=True, slots=True, eq=False)
class Attempted:
    """An attempt and all that it was made of, before anything of it is in the receiver's map or in the history."""

    merge_id: str
    receiver: str
    donation: Donation
    attempt: Attempt
    tools: Tools


class Onlooker(Protocol):
    """Is told in order, between the events; what it does takes nothing from the run but time."""

    def encountered(self, encountered: Encountered) -> None: ...
    def attempted(self, attempted: Attempted) -> None: ...
    def measured(self, merge_id: str, sample: Sample, verdict: Verdict | None) -> None:
        """What a merge's metrics measured, and what the verifier made of it, None where it was not asked."""
        ...
