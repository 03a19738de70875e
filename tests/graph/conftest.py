"""What the tests of the graph are made of."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.graph.claims import Claim, Source

SOURCES = st.builds(Source, st.sampled_from("abcde"), st.integers(1, 2))


def transforms() -> st.SearchStrategy[Transform]:
    """Planar ones of a building's size."""
    return st.builds(Transform.planar, st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.14, 3.14))


def _claims() -> st.SearchStrategy[Claim]:
    """Of few edges and epochs, so that many are about the same."""
    return st.builds(
        Claim,
        receiver=SOURCES,
        donor=SOURCES,
        epoch=st.integers(1, 2),
        state=st.sampled_from(["provisional", "confirmed", "reverted"]),
        revision=st.integers(0, 2),
        T_receiver_donor=transforms(),
        scale=st.sampled_from([1.0, 0.5]),
        covariance=st.sampled_from([None, np.eye(6) * 0.01]),
        support=st.floats(-20, 20),
        stamp_ns=st.integers(0, 10),
        by=st.sampled_from(["sequential", "person"]),
        reason=st.text(max_size=12),
    ).filter(lambda claim: claim.receiver != claim.donor)


@pytest.fixture(scope="session")
def claims() -> st.SearchStrategy[Claim]:
    return _claims()
