"""One merge: the edge receiver←donor from the moment the donor's data is in until it is taken out."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

from mapgraft.attempt import Grafted, Meeting
from mapgraft.comparison import Compared
from mapgraft.contracts import (
    RECENT_SAMPLES,
    LocalTracker,
    Match,
    Measurement,
    Provenance,
    Sample,
    Step,
    Tracker,
    Transform,
    Verdict,
)
from mapgraft.errors import PluginError
from mapgraft.graph.chains import Chain
from mapgraft.graph.support import as_believed, support_of
from mapgraft.graph.trial import Trial
from mapgraft.procedures import Tools
from mapgraft.refusals import NEAR_M, NEAR_RAD
from mapgraft.registration import Site, displacement
from mapgraft.rhythm import Rhythm
from mapgraft.trail import Trail

State = Literal["provisional", "confirmed", "reverted"]
NEVER: Final = 1 << 60  # observations


@dataclass(slots=True)
class _Watch:
    """One metric of one merge: its tracker, how far it has followed the trail, and what it measured last.

    ``local`` is the tracker where it says what concerns it in the units that the trail is told in; where maps are
    ``converted`` to meet, the receiver's regions say nothing.
    """

    tracker: Tracker
    seen: int
    converted: bool
    local: LocalTracker | None
    everything: bool = True
    donor_changed: bool = False
    latest: Measurement | None = None

    @classmethod
    def begin(cls, tracker: Tracker, seen: int, converted: bool) -> _Watch:
        return cls(tracker, seen, converted, tracker if isinstance(tracker, LocalTracker) and not converted else None)

    def is_concerned(self, trail: Trail) -> bool:
        """Whether anything has happened that may make a difference to it."""
        if self.everything or self.latest is None:
            return True
        if self.seen == trail.now:
            return False
        concerns = None if self.local is None else self.local.concerns
        return concerns is None or trail.since(self.seen).meets(concerns)

    def ask(self, trail: Trail) -> Measurement:
        """What the tracker measures now."""
        stretch = trail.since(self.seen)
        unknown = self.converted or self.everything or not len(stretch)
        step = Step(None if unknown else stretch.touched, stretch.observations, self.donor_changed)
        self.everything = self.donor_changed = False
        self.latest = self.tracker.update(step)
        return self.latest


@dataclass(slots=True)
class _Round:
    """The metrics of a merge that are asked at one rhythm."""

    rhythm: Rhythm
    watches: dict[str, _Watch] = field(default_factory=dict)
    asking: str = ""

    def next_after(self, now: int) -> int:
        return self.rhythm.next_after(now) if self.watches else now + NEVER

    def look(self, trail: Trail, everything: bool, into: dict[str, Measurement]) -> bool:
        """Ask those that are concerned, put what all of them measure into a mapping; False when nobody was asked."""
        asked = False
        for name, watch in self.watches.items():
            self.asking = name
            if everything or watch.latest is None or watch.is_concerned(trail):
                into[name], asked = watch.ask(trail), True
            else:
                into[name] = watch.latest  # what it said last still holds
            watch.seen = trail.now
        return asked


@dataclass(slots=True)
class Merge:
    """A standing merge with its metrics. ``merge_id`` is ``<receiver>.<donor>.<n>``.

    ``match`` is the hypothesis by which it stands now, ``site`` where the donor's map is, ``meeting`` the two maps as
    far as they are needed to register the merge anew. ``stood`` are the transforms at which it stood: the first is the
    one that was accepted, the last that of now. ``history`` holds the samples that have all the verifier looks
    at: the first one, and the latest. ``verdict`` is the verifier's latest word. With a ``chain`` it is no merge of the
    receiver's own: the donor's layer was attached through others. ``corrections`` tells how often the receiver's and
    the donor's maps had been corrected when they were held against each other first, ``writer`` who wrote the layer.
    ``epoch`` is that of its claim: the n of its id, unless somebody else has told of merges under the receiver's name.
    """

    merge_id: str
    tools: Tools
    match: Match
    provenance: Provenance
    comparison: Compared
    reversal: str
    trail: Trail
    site: Site
    meeting: Meeting | None = None
    chain: Chain | None = None
    corrections: tuple[int, int] = (0, 0)
    writer: bytes = b""
    state: State = "provisional"
    history: list[Sample] = field(default_factory=list)
    decided_by_person: bool = False
    trial: Trial | None = None  # where it contradicts other merges, what both maps say of it by themselves
    unwatched: bool = False  # what measures or judges it has failed: it stays as it is
    verdict: Verdict | None = None
    complaints: list[PluginError] = field(default_factory=list)  # of metrics that judge nothing
    due_at: int = 0  # observation of the receiver at which there is something to do next
    stood: list[Transform] = field(init=False)
    epoch: int = field(init=False)
    _began: int = 0
    _placed: int = 0
    _registered: int = 0
    _known: tuple[int, int] = (0, 0)
    _told: int = 0
    _said: str = ""
    _judged: _Round = field(init=False)
    _logged: _Round = field(init=False)

    def __post_init__(self) -> None:
        verify = self.tools.procedure.verify
        self._judged, self._logged = _Round(self._rhythm(verify.every)), _Round(self._rhythm(verify.told_every))
        self.stood = [self.comparison.T_receiver_donor]
        self.epoch = int(self.merge_id.rpartition(".")[2])

    @property
    def donor(self) -> str:
        return self.provenance.source

    @property
    def observations(self) -> int:
        """How many own observations the receiver has made since the merge."""
        return self.trail.now - self._began

    @property
    def seen(self) -> int:
        """How many of the receiver's observations all metrics have looked at."""
        return min((watch.seen for watch in self._watches), default=self.trail.now)

    @property
    def _watches(self) -> list[_Watch]:
        return [*self._judged.watches.values(), *self._logged.watches.values()]

    def start(self, stamp_ns: int, accepted: Sequence[Measurement] = ()) -> Sample:
        """Begin to track every metric of the procedure; the first sample is of the moment of the merge.

        Where a merged map is compared, what only goes into the log is remembered as it was when the match was
        ``accepted``: by now the map holds the donor itself.
        """
        verify, now = self.tools.procedure.verify, self.trail.now
        self._began = self._registered = self._told = self._placed = now
        if self.meeting is not None:
            self._known = (self.meeting.target.known(), self.meeting.source.known())
        for name in dict.fromkeys((*verify.metric_names, *verify.log.metrics)):
            tracker = self.tools.metrics[name].track(self.comparison)
            rhythm = self._judged if name in verify.metric_names else self._logged
            rhythm.watches[name] = _Watch.begin(tracker, now, self.comparison.converted)
        sample = self.measure(stamp_ns, everything=True)
        self._said = "keep"
        if sample is not None and self.comparison.subject == "merged":
            before = {m.name: m for m in accepted if m.name in self._logged.watches}
            self.history[0] = dataclasses.replace(sample, measurements={**sample.measurements, **before})
        return sample or Sample(stamp_ns, 0, {})

    def restart(self, stamp_ns: int) -> None:
        """One of the maps is another one now: what has been told so far was told of the one that it was.

        It stands where it was put last, and the state stays. Raises PluginError when a metric fails.
        """
        del self.stood[:-1]
        self.trial = None
        if self.unwatched:
            return
        self._judged.watches.clear()
        self._logged.watches.clear()
        self.history.clear()
        self.verdict = None
        self.start(stamp_ns)

    def replace(self, grafted: Grafted) -> None:
        """The donor's layer or the transform is another one now: the metrics must look at everything again.

        The history goes on: what the donor has newly mapped tests the transform as much as what the receiver has.
        """
        self.match, self.provenance = grafted.match, grafted.contribution.provenance
        self.meeting = None if self.meeting is None else grafted.meeting
        made = grafted.comparison
        self.comparison.put_donor(made.donor_layer, made.T_receiver_donor, made.match)
        if made.T_receiver_donor != self.stood[-1]:
            self.stood.append(made.T_receiver_donor)
        self._placed = self.trail.now
        for watch in self._watches:
            watch.everything = watch.donor_changed = True
            watch.seen = self.trail.now

    def target_changed(self) -> None:
        """The receiver's map has changed otherwise than by an observation."""
        for watch in self._watches:
            watch.everything = True

    def measure(self, stamp_ns: int, everything: bool = False) -> Sample | None:
        """Measure what is due, or ``everything``; None when nothing has happened that makes a difference.

        The history has one sample per number of observations, the latest: looking twice is not seeing twice.
        """
        trail, now = self.trail, self.trail.now
        measured: dict[str, Measurement] = {}
        judged = logged = False
        if everything or self._judged.rhythm.is_due(now):
            judged = self._judged.look(trail, everything, measured)
        if everything or self._logged.rhythm.is_due(now):
            logged = self._look_for_the_record(everything, measured)
        self._plan()
        if not (judged or logged or everything):
            return None
        state: Literal["provisional", "confirmed"] = "confirmed" if self.state == "confirmed" else "provisional"
        sample = Sample(stamp_ns, self.observations, measured, state)
        if everything or self._judged.rhythm.is_due(now) or not self._judged.watches:
            self._remember(sample)  # it has all the verifier looks at, and may have more
        return sample

    def _look_for_the_record(self, everything: bool, into: dict[str, Measurement]) -> bool:
        """What judges nothing may fail: it is left out from then on."""
        while True:
            try:
                return self._logged.look(self.trail, everything, into)
            except PluginError as error:
                del self._logged.watches[self._logged.asking]
                self.complaints.append(error)

    def _remember(self, sample: Sample) -> None:
        if len(self.history) > 1 and self.history[-1].observations == sample.observations:
            self.history.pop()
        self.history.append(sample)
        if len(self.history) > 1 + RECENT_SAMPLES:
            del self.history[1]

    def _plan(self) -> None:
        """Find out when there is something to do again."""
        now = self.trail.now
        if self.unwatched:
            self.due_at = now + NEVER
            return
        self.due_at = min(self._judged.next_after(now), self._logged.next_after(now))
        if (due := self._register_at) is not None:
            self.due_at = min(self.due_at, max(due, now + 1))

    @property
    def _register_at(self) -> int | None:
        """When it is to be asked again whether the maps have grown; a merge that stays where it is never is."""
        every = self.tools.rule.refine.every
        if every is None or not self.may_move:
            return None
        if self.comparison.converted:  # to know how much a converted map knows costs the map, too
            return self._rhythm(every).next_after(self._registered)
        return self._registered + every

    def _rhythm(self, every: int) -> Rhythm:
        return Rhythm(every, sparing=self.comparison.converted)

    @property
    def may_move(self) -> bool:
        """Whether it may be registered anew; what a person decided stays where it is, and what others found out."""
        return self.meeting is not None and self.chain is None and not (self.decided_by_person or self.unwatched)

    def is_near(self, T_receiver_donor: Transform) -> bool:
        """Whether a transform puts the donor where it stands, give or take what a map is bent by."""
        shift_m, turn_rad = displacement(self.comparison.T_receiver_donor, T_receiver_donor, self.site.about_m)
        return shift_m <= NEAR_M and turn_rad <= NEAR_RAD

    def shift_to(self, T_receiver_donor: Transform) -> str:
        """By how much a transform puts the donor elsewhere, for a person."""
        shift_m, turn_rad = displacement(self.comparison.T_receiver_donor, T_receiver_donor, self.site.about_m)
        return f"{shift_m:.2f} m, {math.degrees(turn_rad):.2f}°"

    def stop_watching(self) -> None:
        """Ask nobody about it any more: it stays as it is."""
        self.unwatched = True
        self._judged.watches.clear()
        self._logged.watches.clear()
        self._plan()

    def is_to_register(self) -> bool:
        """Whether it is time to ask whether the maps have grown enough to register the merge anew."""
        due = self._register_at
        return due is not None and self.trail.now >= due

    def has_grown(self, meeting: Meeting) -> bool:
        """Whether one of the maps that meet knows so much more now that the merge is to be registered anew.

        If so that is taken as done, if not it is asked again when it is time the next time.
        """
        known = (meeting.target.known(), meeting.source.known())
        least = 1.0 + self.tools.rule.refine.growth
        self._registered = self.trail.now
        self._plan()
        if not any(now >= least * before for now, before in zip(known, self._known, strict=True)):
            return False
        self._known = known
        return True

    @property
    def has_news(self) -> bool:
        """Whether anything has happened since the metrics were last asked that makes a difference to them."""
        return any(watch.is_concerned(self.trail) for watch in self._watches)

    @property
    def was_tested(self) -> bool:
        """Whether the receiver has observed anything since the donor's layer was put where it is."""
        return self.trail.now > self._placed

    @property
    def is_untold(self) -> bool:
        """Whether the last sample was not written down."""
        return bool(self.history) and self._began + self.history[-1].observations > self._told

    def judge(self) -> Verdict:
        """The verifier's word on the history so far."""
        history = self.history if self.chain is None else as_believed(self.history, self.chain.support)
        self.verdict = self.tools.verifier.verify(history, self.reversal)
        return self.verdict

    @property
    def support(self) -> float:
        """The log-odds (nats) that it is right, as its robot judges now; what it was tried for last tells most."""
        if self.trial is not None and not self.decided_by_person:
            return self.trial.support
        return support_of(self.history, self.verdict, self.state == "confirmed", self.decided_by_person)

    def tells(self, verdict: Verdict, wanted: bool = False) -> bool:
        """Whether a verdict is written down: it is wanted, not the last one again, or the time of the log has come."""
        every = self.tools.procedure.verify.told_every
        if not wanted and verdict.action == self._said and self.trail.now // every == self._told // every:
            return False
        self._told, self._said = self.trail.now, verdict.action
        return True
