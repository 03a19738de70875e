"""Layers that are in a robot's map through the merges of others: attached, attached anew, and detached."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from mapgraft.attempt import Grafted, Meeting
from mapgraft.contracts import Donation, MapMetadata, Match, Prior
from mapgraft.decision import DecisionTable, Rule, facts_of
from mapgraft.errors import MapError, PluginError
from mapgraft.exchange import SentLayer
from mapgraft.graph.chains import Chain
from mapgraft.graph.claims import Source
from mapgraft.graph.held import Layers
from mapgraft.merge import Merge
from mapgraft.persons import same_place, sigma_m
from mapgraft.procedures import Tools
from mapgraft.registration import Site
from mapgraft.standing import Standing

BY: Final = "graph"


@dataclass(slots=True)
class Attachments:
    """What one robot has attached. ``bring_about`` makes it what is wanted, and tells every difference.

    What is in the map is a function of the robot's own layer, the chains and the layers that are held: when any of them
    has changed the contribution is made again. ``left_aside`` remembers what was told of sources that are not attached.
    """

    standing: Standing
    table: DecisionTable
    counts: dict[str, int] = field(default_factory=dict)
    left_aside: dict[Source, str] = field(default_factory=dict)
    _made_of: dict[Source, tuple[int, int]] = field(default_factory=dict)  # versions of the donor's and the own layer

    def bring_about(
        self, wanted: Mapping[Source, Chain], layers: Layers, why_not: Callable[[Chain], str], stamp_ns: int
    ) -> None:
        """Detach what is no longer wanted, ``why_not`` its chain holds; attach what is, as it lies now."""
        for source, merge in sorted(self.standing.attached.items()):
            if source not in wanted and merge.chain is not None:
                self.detach(source, why_not(merge.chain), stamp_ns)
        for source, chain in sorted(wanted.items()):
            sent = layers.sent(source)
            if sent is None:
                continue
            try:
                if source in self.standing.attached:
                    self._renew(source, self.standing.attached[source], chain, sent, stamp_ns)
                else:
                    self._attach(source, chain, sent, stamp_ns)
            except MapError as error:
                self.detach(source, str(error), stamp_ns)
                self.leave(source, str(error), stamp_ns)
            except PluginError as error:
                self.detach(source, str(error), stamp_ns)
                self.standing.complain(error, stamp_ns, source.name)

    def detach(self, source: Source, reason: str, stamp_ns: int) -> None:
        """Take an attached layer out again, if it is there; raises IrreversibleError when the map type cannot."""
        merge = self.standing.attached.get(source)
        if merge is None:
            return
        exactness = self.standing.take_out(merge, stamp_ns, reason)
        del self.standing.attached[source]
        self._made_of.pop(source, None)
        merge.state = "reverted"
        self.standing.journal.changed("detached", stamp_ns, merge, reason, BY, exactness=exactness)
        self.standing.show("after revert", stamp_ns, merge.merge_id)

    def _attach(self, source: Source, chain: Chain, sent: SentLayer, stamp_ns: int) -> None:
        donation = self.standing.own.receive(sent)
        other = self._metadata(donation)
        site = Site.of(self.standing.own.own_metadata(), other)
        match = _match(chain)
        if why := self._refused(source, match, site):
            self.leave(source, why, stamp_ns)
            return
        tools = self._tools(source, other, chain, stamp_ns)
        if tools is None:
            return
        meeting = self.standing.attempts.meet(tools, donation)
        grafted = self.standing.attempts.graft(tools, meeting, match)
        self.counts[source.name] = self.counts.get(source.name, 0) + 1
        name = f"{chain.target.name}.{source.name}.via.{self.counts[source.name]}"
        self._enter(name, source, chain, tools, grafted, site, sent)
        self.left_aside.pop(source, None)
        reason = f"through {_told(chain)}"
        merge = self.standing.attached[source]
        self.standing.journal.changed("attached", stamp_ns, merge, reason, BY, size=sent.size)
        self.standing.show("after merge", stamp_ns, name)
        with self.standing.own.naming():
            merge.start(stamp_ns)

    def _enter(
        self, name: str, source: Source, chain: Chain, tools: Tools, grafted: Grafted, site: Site, sent: SentLayer
    ) -> None:
        standing, contribution = self.standing, grafted.contribution
        made = (name, tools, grafted.match, contribution.provenance, grafted.comparison, standing.reversal.name)
        with standing.workshop.guard.calling("fuser", tools.procedure.fuse.use):
            if name in standing.reversal.contributions:
                standing.reversal.replace(name, contribution)
            else:
                standing.reversal.merge(name, contribution)
        corrections = (standing.own.corrections, sent.corrections)
        entered = (standing.trail, site, grafted.meeting, chain, corrections, sent.writer)
        standing.attached[source] = Merge(*made, *entered)
        self._made_of[source] = (contribution.provenance.version, standing.reversal.version)

    def _renew(self, source: Source, merge: Merge, chain: Chain, sent: SentLayer, stamp_ns: int) -> None:
        """Make the contribution again where anything it is made of has changed."""
        standing, match, version = self.standing, _match(chain), sent.provenance.version
        T = match.T_receiver_donor
        moved = merge.match.T_receiver_donor != T or match.scale != merge.match.scale
        newer = version != merge.provenance.version
        if (moved or newer) and merge.was_tested and merge.has_news:  # by the transform that stood
            standing.verify(merge, stamp_ns, everything=True)
            if any(one is merge for one, _ in standing.doubted):
                return
        before, merge.chain = merge.chain, chain
        meeting = self._meeting(merge, sent)
        if why := self._refused(source, match, merge.site):
            raise MapError(why)
        if not (moved or newer) and self._made_of[source] == (version, standing.reversal.version):
            return
        grafted = standing.attempts.graft(merge.tools, meeting, match)
        if not same_place(merge.comparison.T_receiver_donor, T, merge.site.about_m):  # what spoke for it no longer does
            self._enter(merge.merge_id, source, chain, merge.tools, grafted, merge.site, sent)
            merge = standing.attached[source]
            with standing.own.naming():
                merge.start(stamp_ns)
        else:
            self._swap(source, merge, grafted, moved or newer)
            if sent.corrections != merge.corrections[1]:
                merge.corrections = (merge.corrections[0], sent.corrections)
                with self.standing.own.naming():
                    merge.restart(stamp_ns)
        if moved or newer:
            reason, size = _why_anew(before, chain, newer), sent.size if newer else 0
            standing.journal.changed("reattached", stamp_ns, merge, reason, BY, size=size)

    def _refused(self, source: Source, match: Match, site: Site) -> str:
        """Why a source may not lie there; empty where it may."""
        refused = self.standing.attempts.refusals.at(source.name, match.T_receiver_donor, site.about_m)
        return f"{refused[0].merge_id} was reverted there" if refused else ""

    def _swap(self, source: Source, merge: Merge, grafted: Grafted, is_other: bool) -> None:
        """Replace the contribution; where the layer or the transform ``is_other`` now, the metrics must look again."""
        with self.standing.workshop.guard.calling("fuser", merge.tools.procedure.fuse.use):
            self.standing.reversal.replace(merge.merge_id, grafted.contribution)
        self._made_of[source] = (grafted.contribution.provenance.version, self.standing.reversal.version)
        if is_other:
            merge.replace(grafted)

    def _meeting(self, merge: Merge, sent: SentLayer) -> Meeting:
        """Where the held layer meets the own one, and where in it its map is; as it was when it is the same layer."""
        if merge.meeting is not None and merge.meeting.provenance == sent.provenance:
            return merge.meeting
        donation = self.standing.own.receive(sent)
        merge.site = Site.of(self.standing.own.own_metadata(), self._metadata(donation))
        return self.standing.attempts.meet(merge.tools, donation)

    def _metadata(self, donation: Donation) -> MapMetadata:
        own, other = self.standing.own.map_type, donation.layer.map_type
        map_type = own if other == own.name else self.standing.workshop.map_type(other)
        return map_type.metadata(donation.layer)

    def _tools(self, source: Source, other: MapMetadata, chain: Chain, stamp_ns: int) -> Tools | None:
        """The tools of the first rule that applies to the two maps, by themselves or with the chain as a prior."""
        rule = None
        for prior in (None, _prior(chain)):
            rule, reason = self._rule(other, prior)
            if rule is not None:
                return self.standing.workshop.tools(rule)
        self.leave(source, reason, stamp_ns)
        return None

    def _rule(self, other: MapMetadata, prior: Prior | None) -> tuple[Rule | None, str]:
        own, workshop = self.standing.own.own_metadata(), self.standing.workshop
        rules = [record.rule for record in self.table.records]
        passed = {id(rule): why for rule in rules if (why := workshop.out_of_order(rule, own.type, other.type))}
        ruling = self.table.choose(facts_of(own, other, sigma_m(prior), self.standing.reversal.name), passed)
        return (None if ruling.rejected else ruling.rule), ruling.reason

    def leave(self, source: Source, reason: str, stamp_ns: int) -> None:
        """Say once why something that is reachable is not attached."""
        if self.left_aside.get(source) != reason:
            self.left_aside[source] = reason
            self.standing.journal.left_aside(stamp_ns, source.name, reason, BY)


def _match(chain: Chain) -> Match:
    """The composed transform as a hypothesis; its score is the chain's support (nats)."""
    placed, support = chain.similarity, min(chain.support, 1e3)
    evidence = {"chain_support": support, "chain_merges": float(len(chain.claims))}
    T = placed.T_target_source.snapped()
    return Match(T, support, math.inf, placed.scale, placed.covariance, evidence)


def _prior(chain: Chain) -> Prior | None:
    placed = chain.similarity
    return None if placed.covariance is None else Prior(placed.T_target_source, placed.covariance, BY)


def _ids(chain: Chain) -> tuple[str, ...]:
    return tuple(claim.merge_id for claim in chain.claims)


def _told(chain: Chain) -> str:
    """The chain for people: whom it passes, by which merges, and how sure they are."""
    passed = " → ".join(source.name for source in chain.sources)
    return f"{passed} ({', '.join(_ids(chain))}; support {min(chain.support, 1e3):.1f} nats)"


def _why_anew(before: Chain | None, now: Chain, newer: bool) -> str:
    what = "there is a newer layer" if newer else "the transform has moved"
    if before is None or _ids(before) != _ids(now):
        what = f"now through {_told(now)}"
    return what
