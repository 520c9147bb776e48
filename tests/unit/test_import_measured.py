"""The shipped mappings and models fit the measured data that they were written for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, Trajectory
from gfm.importing import imported, mapping_of
from gfm.importing.guess import Asked, Robot, guessed_mapping

ROOT = Path(__file__).resolve().parents[2]
Measured = Callable[[str, str], list[Trajectory]]


def model(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(ROOT / "models" / name))


def actuated(spec: mujoco.MjModel) -> tuple[str, ...]:
    names = tuple(spec.actuator(i).name for i in range(spec.nu))
    assert names == tuple(spec.joint(i).name for i in spec.actuator_trnid[:, 0])
    return names


def test_xl330(measured: Measured) -> None:
    runs = {run.name: run for run in measured("bam_xl330/raw/*.json.gz", "xl330.toml")}
    assert len(runs) == 20
    assert {run.joint_names for run in runs.values()} == {actuated(model("xl330_pendulum.xml"))}
    assert runs["kp200_sin_sin"].servo_gain == {"joint": 0.5}
    drop = runs["kp800_lift_and_drop_released"]
    assert drop.servo_gain == {"joint": 0.0}
    assert drop.duration_s == pytest.approx(4.0, abs=0.01)
    assert abs(drop.position[-200:]).max() < 0.1 < abs(drop.position[0, 0])


def test_xl330_servo_is_what_its_data_sheet_says() -> None:
    pendulum = model("xl330_pendulum.xml")
    stall = 0.52 * 7.4 / 5.0
    duty_per_rad = 400 / 256 * 4096 / (2 * np.pi) / 885
    assert pendulum.actuator_forcerange[0, 1] == pytest.approx(stall, rel=1e-3)
    assert pendulum.actuator_gainprm[0, 0] == pytest.approx(duty_per_rad * stall, rel=1e-3)
    no_load_speed = stall / -pendulum.actuator_biasprm[0, 2]
    assert no_load_speed == pytest.approx(103 * 7.4 / 5.0 * 2 * np.pi / 60, rel=1e-3)


def test_double_pendulum(measured: Measured) -> None:
    runs = measured("dfki_double_pendulum/C1_*-1436*.csv.gz", "double_pendulum.toml")
    assert {run.joint_names for run in runs} == {actuated(model("double_pendulum_c1.xml"))}
    assert all(run.effort is not None for run in runs)


def test_double_pendulum_weighs_what_its_authors_say() -> None:
    """Both links level: m1 g r1 + m2 g (l1 + r2) at the shoulder, m2 g r2 at the elbow."""
    arm = model("double_pendulum_c1.xml")
    data = mujoco.MjData(arm)
    data.qpos[0] = np.pi / 2
    mujoco.mj_forward(arm, data)
    assert data.qfrc_bias[1] == pytest.approx(0.62557 * 9.81 * 0.25569, rel=1e-4)
    assert data.qfrc_bias[0] == pytest.approx(9.81 * (0.52346 * 0.2 + 0.62557 * 0.45569), rel=1e-4)
    full = np.zeros((2, 2))
    mujoco.mj_fullM(arm, data, full)
    assert full[1, 1] == pytest.approx(0.05087 + 36 * 6.2872e-5, rel=1e-3)


def test_so101(measured: Measured) -> None:
    runs = measured("so101/slow_precision_*.csv.gz", "so101.toml")
    (run,) = runs
    assert run.joint_names[0] == "shoulder_pan"
    assert np.median(np.diff(run.time_s)) == pytest.approx(0.0201, abs=2e-4)
    assert abs(run.position - run.command).max() < 0.5
    assert run.effort is None


def test_a_guess_reads_a_double_pendulum_as_the_shipped_mapping_does(measured: Measured) -> None:
    name = "dfki_double_pendulum/C1_20230629-143339.csv.gz"
    (shipped,) = measured(name, "double_pendulum.toml")
    path = ROOT.parent / "shared" / "data" / "measured" / name
    robot = Robot(joints=("shoulder", "elbow"), command_kind=CommandKind.EFFORT)
    asked = Asked(use=("pos_meas", "vel_meas", "tau_meas", "tau_con"))
    text = guessed_mapping(path, robot, asked)
    (guessed,) = imported([path], mapping_of(text, "guess"))
    assert guessed.joint_names == shipped.joint_names
    for signal in ("stamp_ns", "position", "velocity", "effort", "command"):
        np.testing.assert_array_equal(getattr(guessed, signal), getattr(shipped, signal))
