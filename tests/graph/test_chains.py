"""Chains of claims: transforms compose, the best supported wins, and nothing depends on what was heard first."""

from __future__ import annotations

import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.graph.chains import PER_NAT, Chain, Similarity, best_chains, seen_from, surprise
from mapgraft.graph.claims import Claim, Source

A, B, C, D = (Source(name, 1) for name in "abcd")


def same(one: Similarity, other: Similarity) -> bool:
    near = np.allclose(one.T_target_source.matrix, other.T_target_source.matrix, atol=1e-6)
    return near and math.isclose(one.scale, other.scale, rel_tol=1e-9)


@given(st.data())
def test_similarities_are_a_group(transforms, data) -> None:
    scales = st.sampled_from([0.5, 1.0, 1.7])
    p, q, r = (Similarity(data.draw(transforms), data.draw(scales)) for _ in range(3))
    assert same(p.then(q).then(r), p.then(q.then(r)))
    assert same(p.then(p.inverse()), Similarity.identity())
    assert same(p.inverse().then(p), Similarity.identity())
    assert same(p.then(q).inverse(), q.inverse().then(p.inverse()))


@given(st.data())
@settings(max_examples=5, deadline=None)
def test_covariances_are_those_of_perturbed_transforms(transforms, data) -> None:
    """First order against ten thousand draws."""
    sigma = np.diag(np.array([0.02, 0.03, 0.0, 0.0, 0.0, 0.001]) ** 2)
    p, q = (Similarity(data.draw(transforms), 1.0, sigma) for _ in range(2))
    rng = np.random.default_rng(7)

    def perturbed(one: Similarity) -> Transform:
        x, y, yaw = rng.normal(0.0, [0.02, 0.03, 0.001])
        T = one.T_target_source
        return Transform.planar(T.x_m + x, T.y_m + y, T.yaw_rad + yaw)

    drawn = [perturbed(p) @ perturbed(q).inverse() for _ in range(3000)]
    found = np.cov(np.array([(T.x_m, T.y_m) for T in drawn]).T)
    told = p.then(q.inverse()).covariance
    assert told is not None
    assert np.allclose(found, told[:2, :2], rtol=0.2, atol=0.05 * np.trace(found))


def test_a_chain_says_where_a_source_lies(claim, place) -> None:
    chains = best_chains(A, [claim("ab"), claim("cb"), claim("cd")])
    assert set(chains) == {B, C, D}
    found, truth = chains[D].similarity.T_target_source, place("a").inverse() @ place("d")
    assert found.difference(truth)[0] < 1.0
    assert [one.name for one in chains[D].sources] == ["a", "b", "c", "d"]
    assert [one.merge_id for one in chains[D].claims] == ["a.b.1", "c.b.1", "c.d.1"]


def test_the_best_supported_chain_wins_over_the_shortest(claim) -> None:
    weak, strong = claim("ad", support=1.0), [claim("ab", 5.0), claim("bd", 5.0)]
    assert best_chains(A, [weak, *strong])[D].claims == tuple(strong)
    assert best_chains(A, [claim("ad", support=6.0), *strong])[D].claims[0].donor == D


def test_reverted_claims_lead_nowhere(claim) -> None:
    assert best_chains(A, [claim("ab"), claim("bc", state="reverted")]).keys() == {B}


def test_among_equals_names_decide_and_the_nearer_receiver(claim) -> None:
    ways = [claim("ab", 3.0), claim("bd", 3.0), claim("ac", 3.0), claim("cd", 3.0), claim("ba", 3.0)]
    for order in itertools.permutations(ways):
        assert best_chains(A, order)[D].claims == (ways[0], ways[1])


@given(st.data())
@settings(max_examples=60)
def test_chains_do_not_depend_on_the_order_of_hearing(claims, data) -> None:
    heard = data.draw(st.lists(claims, max_size=15, unique_by=lambda one: one.edge))
    start = Source("a", 1)
    first = best_chains(start, heard)
    random.Random(data.draw(st.integers(0, 99))).shuffle(heard)
    assert best_chains(start, heard) == first


@given(st.data())
@settings(max_examples=60)
def test_no_other_walk_is_better(claims, data) -> None:
    heard = data.draw(st.lists(claims, max_size=9, unique_by=lambda one: one.edge))
    start = Source("a", 1)
    best: dict[Source, int] = {}

    def walk(here: Source, passed: frozenset[Source], cost: int) -> None:
        for one in heard:
            if one.is_active and here in one.edge:
                there = one.donor if one.receiver == here else one.receiver
                if there not in passed:
                    total = cost + round(PER_NAT * surprise(one.support))
                    best[there] = min(best.get(there, total), total)
                    walk(there, passed | {there}, total)

    walk(start, frozenset([start]), 0)
    assert {source: chain.cost for source, chain in best_chains(start, heard).items()} == best


def test_support_of_a_chain_is_that_of_all_its_claims(claim) -> None:
    chain = Chain(A, C, (claim("ab", 2.0), claim("bc", -1.0)), 0)
    right = 1.0 / (1.0 + math.exp(-2.0)) / (1.0 + math.exp(1.0))
    assert chain.support == pytest.approx(math.log(right / (1.0 - right)))
    assert chain.state == "provisional"


def test_a_claim_seen_from_its_donor_is_turned_around(claim) -> None:
    one = claim("ab")
    assert same(seen_from(A, one).inverse(), seen_from(B, one))
    assert isinstance(one, Claim)
