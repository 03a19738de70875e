"""Plugins for any map type: known poses, acceptance and verification by thresholds, exchange policies."""

from __future__ import annotations

from mapgraft.contracts import Descriptor, Register, hookimpl

MAPGRAFT_CONTRACT = (1, 0)


@hookimpl
def register_matchers(register: Register) -> None:
    register(
        Descriptor(
            "known_pose",
            "mapgraft_standard.known_pose:KnownPose",
            "takes the relative pose that somebody knows, with its covariance",
            needs_prior=True,
        )
    )


@hookimpl
def register_acceptors(register: Register) -> None:
    register(
        Descriptor(
            "thresholds",
            "mapgraft_standard.acceptance:Thresholds",
            "limits on score, margin, evidence and metrics; says ambiguous when two candidates pass",
        )
    )
    register(
        Descriptor(
            "posterior",
            "mapgraft_standard.posterior:Posterior",
            "takes what is probably enough right, unless it is vetoed; says ambiguous in between",
        )
    )
    register(
        Descriptor(
            "calibrated",
            "mapgraft_standard.calibrated:Calibrated",
            "takes the first hypothesis when a score of its numbers is above a threshold that labels have set",
        )
    )


@hookimpl
def register_metrics(register: Register) -> None:
    register(
        Descriptor(
            "rendezvous",
            "mapgraft_standard.rendezvous:Rendezvous",
            "log Bayes factor of where two robots saw each other, against any place on the map",
        )
    )


@hookimpl
def register_verifiers(register: Register) -> None:
    register(
        Descriptor(
            "thresholds",
            "mapgraft_standard.thresholds:Thresholds",
            "limits per metric and reversal, with patience before a revert and new support before a confirmation",
        )
    )
    register(
        Descriptor(
            "sequential",
            "mapgraft_standard.sequential:Sequential",
            "sequential test on what is new since the merge, with stated error rates",
        )
    )


@hookimpl
def register_policies(register: Register) -> None:
    register(
        Descriptor("every", "mapgraft_standard.policies:Every", "everybody meets every so many seconds, and at the end")
    )
    register(Descriptor("at", "mapgraft_standard.policies:At", "everybody meets at given seconds after the start"))
    register(Descriptor("range", "mapgraft_standard.policies:Range", "robots meet while they are near each other"))
    register(Descriptor("topic", "mapgraft_standard.policies:Topic", "robots meet when a topic of the recording says"))
