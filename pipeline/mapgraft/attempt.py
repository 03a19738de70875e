"""One attempt to merge: match, measure the candidates, accept or not, fuse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

from mapgraft.comparison import Compared, Sight
from mapgraft.contracts import (
    Candidate,
    Contribution,
    Donation,
    Layer,
    Map,
    MapType,
    Match,
    Measurement,
    Prior,
    Provenance,
    Sighting,
    Step,
    Transform,
)
from mapgraft.deciding import Place, deciding_place
from mapgraft.errors import MapError, PluginError
from mapgraft.graph.claims import Source
from mapgraft.graph.support import log_odds_of
from mapgraft.guard import Call
from mapgraft.procedures import Tools, Workshop
from mapgraft.refusals import Refusals
from mapgraft.registration import Move, Site, find_move
from mapgraft.rendezvous import Rendezvous
from mapgraft.reversal import Reversal


@dataclass(slots=True)
class Meeting:
    """The map type in which receiver and donor are compared, and how each side gets there.

    ``donor_type`` is the type of what the donor sent, ``donor_layer`` the same in the meeting type, ``donated`` makes
    what the fuser gets.
    """

    map_type: MapType
    sight: Sight
    donor_type: str
    donor_layer: Layer
    provenance: Provenance
    donated: Callable[[], Layer]
    _source: Map | None = None
    _donation: Donation | None = None

    @property
    def target(self) -> Map:
        """The receiver's compared map as of now."""
        return self.sight()[1]

    @property
    def source(self) -> Map:
        """The donor's map in its own frame; always the same object, so that matchers may keep what they make of it."""
        if self._source is None:
            self._source = self.map_type.view(self.donor_layer)
        return self._source

    @property
    def donation(self) -> Donation:
        """What the fuser gets: in the receiver's type where a conversion leads there, else as the donor sent it."""
        if self._donation is None:
            self._donation = Donation(self.donated(), self.provenance)
        return self._donation


@dataclass(frozen=True, slots=True)
class Grafted:
    """A match made into a contribution, where the two maps met, and what metrics will see of it from now on."""

    match: Match
    contribution: Contribution
    comparison: Compared
    meeting: Meeting


@dataclass(frozen=True, slots=True)
class Attempt:
    """What came of it. ``match`` is the chosen or else the best hypothesis; ``grafted`` is there when accepted.

    ``found`` is what the matcher found, ``candidates`` what the acceptor was shown, ``meeting`` where the maps met.
    Where it is ambiguous, ``place`` tells from where to look to decide, if that is known.
    """

    verdict: Literal["provisional", "ambiguous", "unmatched"]
    reason: str
    hypotheses: int
    match: Match | None = None
    measurements: Sequence[Measurement] = ()
    grafted: Grafted | None = None
    found: Sequence[Match] = ()
    candidates: Sequence[Candidate] = ()
    meeting: Meeting | None = None
    place: Place | None = None


@dataclass(slots=True)
class Attempts:
    """Makes attempts for one receiver, and leaves out the transforms that are refused."""

    workshop: Workshop
    own_type: MapType
    reversal: Reversal
    sights: dict[str, Sight] = field(default_factory=dict)
    refusals: Refusals = field(default_factory=Refusals)
    rendezvous: Rendezvous | None = None
    at: Transform | None = None  # where the robot was last

    def make(self, tools: Tools, donation: Donation, prior: Prior | None, about_m: Sequence[float]) -> Attempt:
        """One attempt with the donor's layer as it is now; ``about_m`` is where the donor's map is, in its frame.

        What a plugin refuses with a MapError comes back as unmatched, with its sentence; raises PluginError when a
        plugin fails in any other way.
        """
        try:
            with self._naming():
                return self._try(tools, donation, prior, about_m)
        except MapError as error:
            return Attempt("unmatched", str(error), 0)

    def _try(self, tools: Tools, donation: Donation, prior: Prior | None, about_m: Sequence[float]) -> Attempt:
        return self._seek(tools, self._meet(donation, tools.rule.via), prior, about_m)

    def _seek(self, tools: Tools, meeting: Meeting, prior: Prior | None, about_m: Sequence[float]) -> Attempt:
        target, source = meeting.target, meeting.source
        empty = [side for side, map_ in (("own", target), ("donor's", source)) if map_.known() == 0]
        if empty:
            return Attempt("unmatched", f"the {' and the '.join(empty)} map knows nothing yet", 0)
        found = tuple(tools.matcher.match(target, source, prior))
        return replace(self._choose(tools, meeting, found, about_m), found=found, meeting=meeting)

    def _choose(self, tools: Tools, meeting: Meeting, found: Sequence[Match], about_m: Sequence[float]) -> Attempt:
        """What came of what the matcher has found."""
        donor = meeting.provenance.source
        sifted = self.refusals.sift(donor, found, tools.rule.retry.reverted, about_m)
        if not sifted.matches:
            they = "the only hypothesis was" if len(found) == 1 else f"all {len(found)} hypotheses were"
            said = f"{they} reverted before: {sifted.refused}"
            said = said if found else "the matcher found no hypothesis"
            return Attempt("unmatched", said, len(found), found[0] if found else None)
        attempt = self._accept(tools, meeting, sifted.matches, len(found))
        if attempt.grafted and (overcome := self.refusals.overcome(donor, attempt.grafted.match, about_m)):
            return replace(attempt, reason=f"{attempt.reason}; {overcome}")
        return attempt

    def again(self, tools: Tools, meeting: Meeting, about_m: Sequence[float]) -> Attempt:
        """One more attempt where the two maps have met already; as ``make``."""
        try:
            with self._naming():
                return self._seek(tools, meeting, None, about_m)
        except MapError as error:
            return Attempt("unmatched", str(error), 0)

    def meet(self, tools: Tools, donation: Donation) -> Meeting:
        """Where a donor's layer meets the receiver's by a rule; raises what a plugin raises, as ``graft``."""
        with self._naming():
            return self._meet(donation, tools.rule.via)

    def graft(self, tools: Tools, meeting: Meeting, match: Match) -> Grafted:
        """The contribution of a donor's layer under a match that has been accepted.

        Raises MapError when a plugin refuses it, PluginError when one fails in any other way.
        """
        with self._naming():
            return self._graft(tools, meeting, match)

    def find_move(
        self, tools: Tools, meeting: Meeting, standing: Match, accepted: Transform, site: Site
    ) -> Move | None:
        """A better transform at the place at which a standing merge was accepted; None where it stands well.

        A place from which the donor was taken out before is none, nor is one for a matcher that refuses the maps.
        Raises PluginError when the matcher fails in any other way.
        """
        try:
            with self._naming():
                move = find_move(tools.matcher, meeting.target, meeting.source, standing, accepted, site)
        except MapError:
            return None
        if move is None:
            return None
        donor = meeting.provenance.source
        here = self.refusals.at(donor, standing.T_receiver_donor, site.about_m)
        there = self.refusals.at(donor, move.match.T_receiver_donor, site.about_m)
        return None if any(refusal not in here for refusal in there) else move

    def _naming(self) -> Call:
        """A context for what is no call of a plugin: what fails there is a layer, a map or a region of the map type."""
        return self.workshop.guard.naming("map type", self.own_type.name)

    def log_odds(self, tools: Tools, meeting: Meeting, match: Match) -> float | None:
        """The log-odds (nats) that a match is right, as the metrics of a rule see both maps now.

        None where no metric tells a probability, or the maps do not meet there. Raises what a plugin raises.
        """
        with self._naming():
            return log_odds_of(self._candidate(tools, meeting, match).measurements.values())

    def changed(self, at: Transform | None = None) -> None:
        """The receiver's map has changed, and where the robot is."""
        self.at = at or self.at
        for sight in self.sights.values():
            sight.changed()

    def _accept(self, tools: Tools, meeting: Meeting, matches: list[Match], hypotheses: int) -> Attempt:
        candidates = [self._candidate(tools, meeting, match) for match in matches[: tools.rule.candidates]]
        decision = tools.acceptor.accept(candidates)
        chosen = candidates[decision.chosen or 0]
        accepted = decision.verdict == "provisional" and decision.chosen is not None
        place = self._deciding(meeting, candidates) if decision.verdict == "ambiguous" else None
        return Attempt(
            decision.verdict,
            decision.reason if place is None else f"{decision.reason}; {place.sentence}",
            hypotheses,
            chosen.match,
            (*chosen.measurements.values(), *([place.measurement] if place else ())),
            self._graft(tools, meeting, chosen.match) if accepted else None,
            candidates=candidates,
            place=place,
        )

    def _deciding(self, meeting: Meeting, candidates: Sequence[Candidate]) -> Place | None:
        """From where to look to tell the two best hypotheses apart; that it cannot be told decides nothing."""
        try:
            matches = [candidate.match for candidate in candidates]
            return deciding_place(meeting.map_type, meeting.target, meeting.source, matches, self.at)
        except (MapError, PluginError):  # a map that cannot be shown is told of when it is
            return None

    def _candidate(self, tools: Tools, meeting: Meeting, match: Match) -> Candidate:
        T = match.T_receiver_donor.snapped()
        placed, meetings = _place(meeting, match), self._meetings(meeting)
        compared = Compared(meeting.map_type, "own", T, match, placed, meeting.sight, meetings=meetings)
        return Candidate(match, {name: metric.track(compared).update(Step()) for name, metric in tools.metrics.items()})

    def _graft(self, tools: Tools, meeting: Meeting, match: Match) -> Grafted:
        contribution = tools.fuser.fuse(self.own_type, self.reversal.own(), meeting.donation, match)
        placed = contribution.layer if meeting.map_type is self.own_type else _place(meeting, match)
        T = contribution.T_receiver_donor
        sight, subject = meeting.sight, self.reversal.subject
        made, converted = (meeting.map_type, subject, T, match, placed, sight), sight.convert is not None
        compared = Compared(*made, converted=converted, meetings=self._meetings(meeting))
        return Grafted(match, contribution, compared, meeting)

    def _meetings(self, meeting: Meeting) -> Callable[[], Sequence[Sighting]]:
        """What tells, at any time, where the receiver and this donor saw each other."""
        if self.rendezvous is None:
            return tuple
        donor = Source(meeting.provenance.source, meeting.provenance.epoch)
        return partial(self.rendezvous.sightings, donor)

    def _meet(self, donation: Donation, via: str | None) -> Meeting:
        own, other = self.own_type.name, donation.layer.map_type
        name = via or own
        meeting_type = self.own_type if name == own else self.workshop.map_type(name)
        if name not in self.sights:
            convert = None if name == own else self.workshop.converter(self.own_type, meeting_type)
            self.sights[name] = Sight(self.reversal, meeting_type, convert)
        met = self._converted(donation.layer, meeting_type)

        def donated() -> Layer:
            if name == own:
                return met
            leads_there = self.workshop.plugins.way(other, own) is not None
            return self._converted(donation.layer, self.own_type) if leads_there else donation.layer

        return Meeting(meeting_type, self.sights[name], other, met, donation.provenance, donated)

    def _converted(self, layer: Layer, target: MapType) -> Layer:
        if layer.map_type == target.name:
            return layer
        return self.workshop.converter(self.workshop.map_type(layer.map_type), target)(layer)


def _place(meeting: Meeting, match: Match) -> Layer:
    return meeting.map_type.place(meeting.donor_layer, match.T_receiver_donor, match.scale)
