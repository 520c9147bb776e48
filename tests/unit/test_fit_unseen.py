"""Policies are compared on recordings that nothing was fitted to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings
from gfm.experiments.fit_unseen import divided, held_back, yardstick
from gfm.experiments.joint_control import ForceModel
from gfm.sim.features import make_features
from gfm.sim.replay import make_replay
from held_object import HELD, HIDDEN, PERIOD_S, recorded, table


@pytest.mark.parametrize(
    ("count", "out"), [(1, []), (2, [1]), (3, [2]), (5, [4]), (9, [4]), (10, [4, 9])]
)
def test_one_recording_in_five_is_held_back(count, out):
    model = table(lies=False)
    assert held_back(model, [recorded(model, HIDDEN, held=HELD)] * count) == out


def test_a_recording_in_which_no_object_is_pushed_is_not_one_to_compare_on():
    model = table(lies=False)
    pushed, at_rest = (recorded(model, x * HIDDEN, held=HELD) for x in (1.0, 0.0))
    assert held_back(model, [pushed, pushed, at_rest]) == [1]
    assert held_back(model, [at_rest, pushed, at_rest]) == []


def test_nothing_is_fitted_to_what_is_held_back():
    model = table(lies=False)
    runs = tuple(recorded(model, HIDDEN, name, held=HELD) for name in "abc")
    given = EnvironmentAssets(models=model.models, trajectories=runs)
    settings = EnvironmentSettings(recordings=("a", "b", "c"), control_period_s=PERIOD_S)
    fitted, loaded, unseen = divided(settings, given)
    assert fitted.recordings == ("a", "b")
    assert loaded.models is given.models
    assert (*loaded.trajectories, *unseen) == runs
    alone = replace(given, trajectories=runs[:1])
    fitted, loaded, unseen = divided(structs.replace(settings, recordings=("a",)), alone)
    assert (fitted.recordings, loaded.trajectories, unseen) == (("a",), runs[:1], ())


def test_an_object_is_compared_by_its_place():
    """Under a constant force it goes f t^2 / 2 m; half of that force leaves half of it."""
    model = table(lies=False)
    run = recorded(model, HIDDEN, held=HELD)
    compared = yardstick(model, [run])
    half = np.zeros((1, len(model.force_limit)), np.float32)
    half[0, [-6, -5, -1]] = 0.5 * HIDDEN / model.force_limit[[-6, -5, -1]]
    features = make_features(model.layout, [make_replay(model, run)])
    forces = ForceModel(model=model, features=features, policy=lambda _: half)
    assert compared.unit == "m"
    assert compared.error(forces) == pytest.approx(0.5 * compared.error(), rel=0.05)
