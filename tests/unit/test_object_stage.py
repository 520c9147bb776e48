"""An object under contact, pushed by a robot that moves as it was measured."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.sim.object_stage import Setting, carrying_forces, make_stage, place, run
from slide import SLIDE


def test_the_robot_follows_its_motion_and_carries_the_object_along():
    stage = make_stage(mujoco.MjSpec.from_string(SLIDE))
    steps = 250
    swept = 0.3 - 0.8 * stage.timestep_s * np.arange(-1, steps + 1)  # rad, towards the object
    begin = Setting(
        pose=np.array([-0.1, 0.0, 0.02, 1.0, 0.0, 0.0, 0.0]),
        velocity=np.zeros(6),
        robot=swept[:, None],
    )
    poses = run(stage, [begin, replace(begin, robot=np.full((steps + 2, 1), 0.6))])
    assert poses[0, -1, 1] < -0.02  # pushed aside
    assert poses[1, -1] == pytest.approx(poses[1, 0], abs=1e-3)
    data = mujoco.MjData(stage.model)
    place(stage, data, begin)
    for force in carrying_forces(stage, begin, steps):
        data.qfrc_applied[:] = force
        mujoco.mj_step(stage.model, data)
    assert data.qpos[stage.qpos] == pytest.approx(swept[-1], abs=1e-6)  # whatever it pushes


def test_segments_of_all_lengths_are_what_each_is_alone():
    stage = make_stage(mujoco.MjSpec.from_string(SLIDE))
    swept = 0.3 - 0.8 * stage.timestep_s * np.arange(-1, 252)
    begin = Setting(
        pose=np.array([-0.1, 0.0, 0.02, 1.0, 0.0, 0.0, 0.0]),
        velocity=np.zeros(6),
        robot=swept[:, None],
    )
    settings = [replace(begin, robot=begin.robot[:n]) for n in (251, 40, 120, 253, 40, 90)]
    together = run(stage, settings)
    for setting, poses in zip(settings, together, strict=True):
        steps = len(setting.robot) - 1
        assert np.array_equal(poses[:steps], run(stage, [setting])[0, :steps])
