"""A campaign's motions in the air: clear of the basket, recorded whole under a load, kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from one_process import robot_of
from rich.console import Console

from gfm.api.models import load_specs
from gfm.api.recordings import read_recordings
from gfm.core import BadInputError, Clock, CommandKind
from gfm.core.checks import Array
from gfm.excitation.motion import Purpose
from gfm.experiments import air_motion, drive_policy
from gfm.experiments.air_motion import air_motions, air_plan
from gfm.experiments.drive_request import DriveRequest
from gfm.experiments.evaluate import EvaluationRequest, load_arm
from gfm.experiments.transfer_models import TransferModels
from gfm.transport import Transport

LOADED = """
[[hidden]]
effect = "payload"
parameters = { mass = 1.0, com_x = 0.0, com_y = 0.0, com_z = 0.1 }
"""


def distance_m(model: mujoco.MjModel, position: Array) -> float:
    """Returns how far the tool is from basket and object along a path, shape (N, J)."""
    data, geoms = mujoco.MjData(model), range(model.ngeom)
    body = model.geom_bodyid
    tool = [g for g in geoms if model.body(body[g]).name == "plate"]
    others = [g for g in geoms if model.body(body[g]).name in ("basket", "object")]
    assert tool
    assert others
    least = np.inf
    for joints in position:
        data.qpos[:7] = joints
        mujoco.mj_kinematics(model, data)
        pairs = [(a, b) for a in tool for b in others]
        least = min(
            least, *(mujoco.mj_geomDistance(model, data, a, b, 0.5, None) for a, b in pairs)
        )
    return float(least)


@contextmanager
def nobody(
    _request: DriveRequest, _clock: Clock, _zero: Array
) -> Iterator[tuple[Transport, Callable[[], None]]]:
    raise BadInputError("no robot is there")
    yield


def test_motions_in_the_air_are_recorded_under_a_load_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "robot.toml").write_text(LOADED)
    task, folder = "position_matching", tmp_path / "in_the_air"
    request = DriveRequest(task=task, robot_config=tmp_path / "robot.toml", out=folder)
    model = TransferModels(task=task, folder=tmp_path).by_positions()
    cell = load_specs(model)[CommandKind.POSITION].compile()
    plan = air_plan(cell, load_arm(EvaluationRequest(task=task)), 8.0, 0)
    assert {one.family.purpose for one in plan.motions} == set(Purpose)
    for one in plan.motions:
        assert distance_m(cell, one.motion.position[::5]) > 0.07

    few = replace(plan, motions=(plan.motions[0], plan.motions[-1]))
    monkeypatch.setattr(air_motion, "air_plan", lambda *_: few)
    monkeypatch.setattr(drive_policy, "robot_of", robot_of)
    made = air_motions(request, model, 8.0, Console(quiet=True))
    assert made.seconds == pytest.approx(few.duration_s)
    assert [len(made.training), len(made.held_out)] == [1, 1]
    for run, one in zip(
        read_recordings([*made.training, *made.held_out]), few.motions, strict=True
    ):
        assert run.command_kind is CommandKind.POSITION
        assert run.duration_s == pytest.approx(len(one.motion.position) * 0.05, abs=0.1)
        assert run.object_track is not None

    monkeypatch.setattr(drive_policy, "robot_of", nobody)
    assert air_motions(request, model, 8.0, Console(quiet=True)) == made
    made.held_out[0].unlink()
    with pytest.raises(BadInputError, match="no robot is there"):
        air_motions(request, model, 8.0, Console(quiet=True))
    assert made.training[0].is_file()
