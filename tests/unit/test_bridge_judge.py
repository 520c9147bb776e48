"""The judge of the bridge's benchmark: what it leaves out is not what it looks for."""

from __future__ import annotations

import numpy as np
import pytest
from bridge_geometry import TARGETS, Geometry, Nearest

from gfm.sim.sawyer import READY
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.sawyer_limits import sawyer_limits

LIMITS = sawyer_limits()


@pytest.fixture(scope="module")
def geometry() -> Geometry:
    return Geometry(BridgeConfig(name="bridge").workspace_m)


def wandering(seed: int, steps: int) -> np.ndarray:
    """Returns a way about the ready pose, in steps of 2 ms, shape (steps, 7)."""
    rng = np.random.default_rng(seed)
    phase, rate = rng.uniform(0.0, 6.3, (2, 7))
    time_s = 2e-3 * np.arange(steps)[:, None]
    return READY + 0.8 * np.sin(phase + rate * time_s)


@pytest.mark.parametrize("seed", range(3))
def test_the_least_distances_are_those_of_measuring_all(geometry: Geometry, seed: int) -> None:
    nearest, least = Nearest(geometry), dict.fromkeys(TARGETS, np.inf)
    exact, measured = dict.fromkeys(TARGETS, np.inf), []
    for position in wandering(seed, 400):
        found = nearest.below(position, least)
        measured.append(len(found))
        least |= found
        exact = {t: min(exact[t], d) for t, d in geometry.distances(position).items()}
        assert least == exact
    assert np.mean(measured) < 2.5


def test_no_distance_shrinks_by_more_than_joints_reach(geometry: Geometry) -> None:
    rng, every = np.random.default_rng(0), np.arange(len(geometry.approach))
    for position in READY + rng.uniform(-1.0, 1.0, (60, 7)):
        step = rng.normal(0.0, 0.02, 7)
        before, after = (geometry.between(place, every) for place in (position, position + step))
        assert (np.abs(after - before) <= geometry.approach @ np.abs(step) + 1e-6).all()


def test_shapes_that_move_together_come_no_nearer(geometry: Geometry) -> None:
    turned = READY + np.array([0, 0, 0.3, 0, 0, 0, 0])
    itself = np.arange(len(geometry.approach))[geometry.of_target["itself"]]
    before, after = geometry.between(READY, itself), geometry.between(turned, itself)
    moves = geometry.approach[itself, 2] > 0.0
    np.testing.assert_allclose(before[~moves], after[~moves], atol=1e-6)
    assert moves.any()
    assert (~moves).any()
