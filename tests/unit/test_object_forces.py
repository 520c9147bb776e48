"""What an object lacks is found where it slides, and how far it is followed is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gfm.envs.object_forces import object_forces
from gfm.envs.pushes import forces_of, make_pushes, object_errors
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings
from gfm.experiments.fit import force_model
from gfm.experiments.fit_warm import warm_start
from gfm.rl.regression import RegressionSettings
from gfm.sim.batch import HybridBatch
from held_object import HELD, HIDDEN, MASS, PERIOD_S, recorded, table


def test_the_force_that_moves_an_object_is_found() -> None:
    model = table(lies=False)
    (found,) = object_forces(model, [recorded(model, HIDDEN)])
    assert found.shape == (99, 6)
    np.testing.assert_allclose(found[:, [0, 1]], np.tile(HIDDEN[:2], (99, 1)), atol=4e-3)
    np.testing.assert_allclose(found[:, 5], HIDDEN[2], atol=2e-5)
    assert not found[:, 2:5].any()


def test_where_nothing_is_lacking_none_is_found() -> None:
    model = table(lies=False)
    (found,) = object_forces(model, [recorded(model, 0.0 * HIDDEN)])
    assert abs(found).max() < 1e-3


def test_an_object_that_friction_holds_needs_none() -> None:
    model = table(lies=True)
    (found,) = object_forces(model, [recorded(model, HIDDEN)])
    assert abs(found).max() < 2e-2  # the weight is 2 N


def test_an_object_is_followed_as_far_as_its_forces_are_known() -> None:
    model = table(lies=False)
    pushes = make_pushes(model, [recorded(model, HIDDEN, held=HELD)])
    known = np.zeros((1, 6))
    known[0, [0, 1, 5]] = HIDDEN
    without = object_errors(model, pushes)
    under = object_errors(model, pushes, lambda *_: known)
    time_s = PERIOD_S * np.arange(1, 92)
    way = 0.5 * np.linalg.norm(HIDDEN[:2]) / MASS * time_s**2
    assert without.place_m == pytest.approx(np.sqrt(np.mean(way**2)), rel=0.1)
    assert under.place_m < 0.1 * without.place_m
    assert under.yaw_rad < 0.1 * without.yaw_rad


def test_an_object_that_rests_says_nothing() -> None:
    model = table(lies=True)
    assert not make_pushes(model, [recorded(model, HIDDEN)])


def test_what_moves_from_the_first_moment_on_is_no_push_from_rest() -> None:
    model = table(lies=False)
    assert not make_pushes(model, [recorded(model, 10.0 * HIDDEN)])


def test_pushes_of_some_recordings_are_those_alone() -> None:
    model = table(lies=False)
    runs = [recorded(model, force, held=HELD) for force in (HIDDEN, 0.0 * HIDDEN, -HIDDEN)]
    pushes = make_pushes(model, runs)
    assert pushes.recording.tolist() == [0, 2]
    assert len(pushes.of([2])) == 1
    np.testing.assert_array_equal(pushes.of([2]).qpos[0], pushes.qpos[1])


def test_a_robot_moves_as_it_was_measured_whatever_its_drive_does() -> None:
    model = table(lies=False)
    pushes = make_pushes(model, [recorded(model, HIDDEN, held=HELD)])
    told = replace(pushes, command=100.0 * pushes.command)
    assert object_errors(model, told) == object_errors(model, pushes)
    batch = HybridBatch(model, 1)
    batch.carry(np.zeros((1, 7)), pushes.joints[:, 5], pushes.speeds[:, 5])
    assert batch.qpos[0, 0] == pushes.joints[0, 5, -1, 0]


def test_a_fit_learns_what_moves_an_object_and_gives_the_arm_nothing() -> None:
    """The force is the same everywhere: what is learned in two recordings holds in a third.

    While the object is held, forces seem to be none: where it rests half of the force is learned.
    """
    model = table(lies=False)
    runs = [recorded(model, HIDDEN, name, held=HELD) for name in ("one", "two")]
    assets = EnvironmentAssets(models=model.models, trajectories=runs)
    settings = EnvironmentSettings(control_period_s=PERIOD_S, horizon=20)
    how = RegressionSettings(hidden=(16,), batch_size=32, epochs=200)
    begun = warm_start(settings, assets, seed=0, regression=how)
    assert begun.lacking
    assert begun.object_errors is not None
    assert begun.settings.object_n == pytest.approx(1.2 * HIDDEN[0], rel=0.1)
    forces = force_model(begun.problem, begun.tensors)
    pushes = make_pushes(forces.model, [recorded(model, HIDDEN, "new", held=HELD)])
    known = forces_of(forces.policy, forces.features, forces.model, pushes)
    there = object_errors(forces.model, pushes, known)
    assert there.place_m < 0.75 * begun.object_errors.place_m
    assert "forces on the object" in begun.about


def test_where_nothing_is_lacking_an_object_gets_no_forces() -> None:
    model = table(lies=True)
    assets = EnvironmentAssets(models=model.models, trajectories=[recorded(model, HIDDEN)])
    begun = warm_start(EnvironmentSettings(control_period_s=PERIOD_S, horizon=20), assets, seed=0)
    assert not begun.lacking
