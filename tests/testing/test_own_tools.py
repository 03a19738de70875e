"""The matchers, fusers and metrics of grids, and the acceptors, verifiers and policies of ours keep the laws."""

from __future__ import annotations

from typing import ClassVar, cast

from mapgraft.contracts import Acceptor, Fuser, MapType, Matcher, Metric, Policy, Verifier
from mapgraft.plugins import load_plugins
from mapgraft.testing import AcceptorLaws, FuserLaws, MatcherLaws, MetricLaws, PolicyLaws, Supply, VerifierLaws
from mapgraft_grid.correlation import Correlation
from mapgraft_grid.log_odds import LogOdds
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_standard import acceptance, known_pose, policies, posterior, sequential, thresholds

PLUGINS = load_plugins()


class Grids(Supply):
    examples = 4

    def make_map_type(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)


class TestCorrelation(Grids, MatcherLaws):
    uses_prior = True

    def make_matcher(self) -> Matcher:
        return Correlation()


class TestKnownPose(Grids, MatcherLaws):
    needs_prior = True
    any_type = True

    def make_matcher(self) -> Matcher:
        return known_pose.KnownPose()


class TestLogOdds(Grids, FuserLaws):
    def make_fuser(self) -> Fuser:
        return LogOdds()


class OfGrids(Grids, MetricLaws):
    def make_metric(self) -> Metric:
        return cast("Metric", PLUGINS.make("metric", str(self.metric_name)))


class TestSimilarityMetric(OfGrids):
    metric_name = "similarity"


class TestDistanceMetric(OfGrids):
    metric_name = "distance"


class TestContradictionMetric(OfGrids):
    metric_name = "contradiction"


class TestKappaMetric(OfGrids):
    metric_name = "kappa"


class TestMarginMetric(OfGrids):
    metric_name = "margin"


class TestRecallMetric(OfGrids):
    metric_name = "recall"


class TestRaysMetric(OfGrids):
    metric_name = "rays"


class TestPathsMetric(OfGrids):
    metric_name = "paths"


class TestPosteriorMetric(OfGrids):
    metric_name = "posterior"


class TestNewsMetric(OfGrids):
    metric_name = "news"
    stream = True


class TestThresholds(AcceptorLaws):
    measured: ClassVar[dict[str, tuple[str, ...]]] = {"similarity": ("limit",)}

    def make_acceptor(self) -> Acceptor:
        return acceptance.Thresholds(margin_min=5.0, metrics={"similarity": {"max": 0.5}})


class TestPosterior(AcceptorLaws):
    measured: ClassVar[dict[str, tuple[str, ...]]] = {"posterior": (), "paths": ()}

    def make_acceptor(self) -> Acceptor:
        return posterior.Posterior(metrics={"posterior": {}, "paths": {"max": 0.5}})


class TestThresholdVerifier(VerifierLaws):
    measured: ClassVar[dict[str, tuple[str, ...]]] = {"similarity": ("limit",)}

    def make_verifier(self) -> Verifier:
        return thresholds.Thresholds(metrics={"similarity": {"max": 0.5}}, confirm_after=20)


class TestSequential(VerifierLaws):
    measured: ClassVar[dict[str, tuple[str, ...]]] = {
        "news": ("agreed", "against", "agreed_m", "places"),
        "posterior": (),
    }

    def make_verifier(self) -> Verifier:
        return sequential.Sequential()


class TestEvery(PolicyLaws):
    def make_policy(self) -> Policy:
        return policies.Every()


class TestAt(PolicyLaws):
    def make_policy(self) -> Policy:
        return policies.At(seconds=[10, 20, 350])
