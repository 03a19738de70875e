"""What the tests of the graph are made of: worlds of sources whose true places are known, and claims about them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.graph.claims import Claim, Source

SOURCES = st.builds(Source, st.sampled_from("abcde"), st.integers(1, 2))
SIGMAS = np.array([0.03, 0.03, 0.0, 0.0, 0.0, 0.003])


def _transforms() -> st.SearchStrategy[Transform]:
    """Planar ones of a building's size."""
    return st.builds(Transform.planar, st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3))


@pytest.fixture(scope="session")
def transforms() -> st.SearchStrategy[Transform]:
    return _transforms()


@pytest.fixture(scope="session")
def claims() -> st.SearchStrategy[Claim]:
    """Claims about few edges and epochs, so that many are about the same."""
    return st.builds(
        Claim,
        receiver=SOURCES,
        donor=SOURCES,
        epoch=st.integers(1, 2),
        state=st.sampled_from(["provisional", "confirmed", "reverted"]),
        revision=st.integers(0, 2),
        T_receiver_donor=_transforms(),
        scale=st.sampled_from([1.0, 0.5]),
        covariance=st.sampled_from([None, np.eye(6) * 0.01]),
        support=st.floats(-20, 20),
        stamp_ns=st.integers(0, 10),
        by=st.sampled_from(["sequential", "person"]),
        reason=st.text(max_size=12),
        corrections=st.sampled_from([(0, 0), (0, 1), (2, 1)]),
    ).filter(lambda claim: claim.receiver != claim.donor)


@pytest.fixture(scope="session")
def place() -> Callable[[str], Transform]:
    """Where a source's map frame truly lies, by its name."""

    def find(name: str) -> Transform:
        rng = np.random.default_rng(sum(name.encode()))
        return Transform.planar(*rng.uniform(-20, 20, 2), rng.uniform(-3, 3))

    return find


@pytest.fixture(scope="session")
def claim(place) -> Callable[..., Claim]:
    """What one source says of another: true within its covariance, or off by so much (x, y, yaw)."""

    def make(pair: str, support: float = 4.0, off: tuple[float, float, float] | None = None, **more) -> Claim:
        receiver, donor = pair
        T = place(receiver).inverse() @ place(donor)
        rng = np.random.default_rng(list(pair.encode()))
        noise = Transform.planar(*(rng.normal(0.0, 1.0, 3) * SIGMAS[[0, 1, 5]]))
        T = T @ noise if off is None else T @ Transform.planar(*off)
        state = more.pop("state", "provisional")
        epoch = more.pop("epoch", 1)
        covariance = np.diag(SIGMAS**2)
        ends = (Source(receiver, 1), Source(donor, 1))
        return Claim(*ends, epoch, state, 0, T, covariance=covariance, support=support, **more)

    return make
