"""The judge of public recordings, and how files become recordings, without the data."""

from __future__ import annotations

import hashlib
import io
import subprocess
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from public import SETS, forearm
from public.double_pendulum import model as double_pendulum
from public.double_pendulum import recording
from public.judge import judged, table
from public.legs_and_arms import bare, halves
from public.source import Clones, Repository

BY_NAME = {one.name: one for one in SETS}
DOUBLE, COMPENSATED = BY_NAME["double_pendulum_c0"], BY_NAME["double_pendulum_c0_compensated"]
ERROR = {"before": 0.3, "after": 0.1, "noise_floor": 2e-4}


def report(*named: tuple[str, float, str]) -> dict[str, Any]:
    effects = [
        {"effect": effect, "confidence": confidence, "joints": joints.split()}
        for effect, confidence, joints in named
    ]
    return {"effects": effects, "error": ERROR, "verdict": "partly_explained"}


def judge(one: Any, *named: tuple[str, float, str]) -> Any:
    return judged(one, "gfm", report(*named), wall_s=60.0, cpu_s=30.0)


def test_what_is_known_is_right_what_may_be_there_is_neither_and_the_rest_is_false() -> None:
    one = judge(
        DOUBLE,
        ("coulomb_friction", 0.9, "shoulder elbow"),
        ("viscous_friction", 0.9, "elbow"),
        ("backlash", 0.9, "elbow"),
        ("payload", 0.4, "elbow"),  # a suspect: claimed by nobody
    )
    assert one.right == (("coulomb_friction", "shoulder"), ("coulomb_friction", "elbow"))
    assert one.false == (("backlash", "elbow"),)
    assert not one.abstained


def test_who_names_nothing_abstains_and_who_names_what_was_compensated_is_wrong() -> None:
    assert judge(COMPENSATED).abstained
    assert judge(COMPENSATED, ("coulomb_friction", 0.9, "elbow")).false


def test_the_table_has_a_row_for_each_answer() -> None:
    rows = table([judge(DOUBLE), judge(DOUBLE, ("backlash", 0.8, "elbow"))]).splitlines()
    assert "| 0 of 2 | names nothing | 0.3000 | 0.1000 |" in rows[2]
    assert "| backlash (elbow) |" in rows[3]
    assert {row.count("|") for row in rows} == {11}


def test_every_set_names_a_whole_commit_hashes_and_a_licence() -> None:
    assert len(BY_NAME) == len(SETS) >= 8
    for one in SETS:
        assert len(one.repository.commit) == 40
        assert all(len(sha) == 64 for sha in one.files.values())
        assert one.repository.licence
        assert one.held_out


def clone(folder: Path, content: bytes) -> Repository:
    at = folder / "owner" / "robot"
    at.mkdir(parents=True)
    (at / "run.csv").write_bytes(content)
    git = ["git", "-C", str(at), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "run"]):
        subprocess.run([*git, *words], check=True)
    told = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True)
    return Repository(name="owner/robot", commit=told.stdout.strip(), licence="MIT")


def test_a_file_is_read_at_the_commit_if_it_has_the_hash(tmp_path: Path) -> None:
    repository, content = clone(tmp_path, b"t,q\n0,1\n"), b"t,q\n0,1\n"
    clones, sha = Clones(folder=tmp_path), hashlib.sha256(content).hexdigest()
    (tmp_path / "owner/robot/run.csv").write_text("changed later")
    assert clones.read(repository, "run.csv", sha) == content
    with pytest.raises(SystemExit, match=f"run.csv has sha256 {sha}; expected 00"):
        clones.read(repository, "run.csv", "00")
    with pytest.raises(SystemExit, match=r"expected absent\.csv"):
        clones.read(repository, "absent.csv", sha)
    with pytest.raises(SystemExit, match=r"no such clone; expected one \(git clone https"):
        Clones(folder=tmp_path / "elsewhere").read(repository, "run.csv", sha)


def test_the_compensation_is_left_out_of_the_command() -> None:
    names = ["time"] + [f"{what}{i}" for what in WHAT for i in (1, 2)]
    rows = np.arange(20 * len(names), dtype=float).reshape(20, -1)
    text = "\n".join([",".join(names), *(",".join(map(str, row)) for row in rows)]).encode()
    whole, asked = recording("run", text), recording("run", text, compensated=True)
    place = names.index("tau_fric1")
    np.testing.assert_array_equal(whole.command - asked.command, rows[:, place : place + 2])
    np.testing.assert_array_equal(whole.position, rows[:, 1:3])


WHAT = ("pos_meas", "vel_meas", "tau_con", "tau_fric", "tau_meas")


#: m2 r2 (kg m) and the elbow's I2 + 36 Ir (kg m^2) of each design, as their builders say.
BUILT = {
    "a0": (0.630 * 0.166, 0.02522 + 36 * 6.0719e-5),
    "c0": (0.597862 * 0.275, 0.05345 + 36 * 6.2872e-5),
    "c1": (0.625568 * 0.255693, 0.05087 + 36 * 6.2872e-5),
}


@pytest.mark.parametrize("design", BUILT)
def test_models_weigh_what_their_builders_say(design: str) -> None:
    moment, inertia = BUILT[design]
    arm = mujoco.MjModel.from_xml_string(double_pendulum(lambda _: b"", design=design))
    data = mujoco.MjData(arm)
    data.qpos[0] = np.pi / 2
    mujoco.mj_forward(arm, data)
    assert data.qfrc_bias[1] == pytest.approx(moment * 9.81, rel=1e-4)
    mass = np.zeros((2, 2))
    mujoco.mj_fullM(arm, data, mass)
    assert mass[1, 1] == pytest.approx(inertia, rel=2e-3)


ROBOT = """
<mujoco>
  <asset><mesh file="none.stl"/></asset>
  <worldbody><body name="base"><freejoint/><geom type="mesh" mesh="none"/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <body name="left"><inertial pos="0 0 -.1" mass="1" diaginertia="1 1 1"/>
      <joint name="hip" axis="0 1 0" armature="0.1" damping="2" frictionloss="3"/>
      <body name="foot"><inertial pos="0 0 -.1" mass="1" diaginertia="1 1 1"/>
        <joint name="ankle" axis="0 1 0"/></body></body>
    <body name="right"><inertial pos="0 0 -.1" mass="1" diaginertia="1 1 1"/>
      <joint name="other" axis="0 1 0"/></body>
  </body></worldbody>
  <actuator><motor joint="hip" ctrlrange="-5 5"/><motor joint="other"/></actuator>
</mujoco>
"""


def test_a_bare_model_has_ideal_joints_servos_and_the_links_that_move() -> None:
    made = mujoco.MjModel.from_xml_string(bare(ROBOT, {"hip": (20.0, 1.5)}))
    assert [made.body(i).name for i in range(1, made.nbody)] == ["base", "left", "foot"]
    assert (made.nv, made.nu) == (1, 1)
    assert (made.dof_armature[0], made.dof_damping[0], made.dof_frictionloss[0]) == (0, 0, 0)
    assert made.actuator_gainprm[0, 0] == 20.0
    assert made.actuator_biasprm[0, 2] == -1.5
    np.testing.assert_array_equal(made.actuator_forcerange[0], [-5.0, 5.0])


def test_a_recording_is_cut_in_two_without_losing_a_row() -> None:
    names = ["time"] + [f"{what}{i}" for what in WHAT for i in (1, 2)]
    rows = np.arange(50 * len(names), dtype=float).reshape(50, -1)
    text = "\n".join([",".join(names), *(",".join(map(str, row)) for row in rows)]).encode()
    run = recording("run", text)
    begin, end = halves(run, at=0.7)
    assert (begin.name, end.name, len(begin.stamp_ns)) == ("run_begin", "run_end", 35)
    np.testing.assert_array_equal(np.concatenate([begin.position, end.position]), run.position)


URDF = b"""
<robot name="arm">
  <link name="base"/><link name="upper"><inertial><mass value="2"/><origin xyz="0 0 -0.1"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://arm/none.stl"/></geometry></visual></link>
  <link name="lower"><inertial><mass value="1"/><origin xyz="0 0 -0.2"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
  <joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 -0.3"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
</robot>
"""


@pytest.mark.parametrize(("joint", "moment"), [("a", 2 * 0.1 + 1 * 0.5), ("b", 1 * 0.2)])
def test_an_arm_of_which_one_joint_turns_carries_all_that_hangs_on_it(
    joint: str, moment: float
) -> None:
    arm = mujoco.MjModel.from_xml_string(forearm.with_one_joint(URDF, joint, 9.0))
    data = mujoco.MjData(arm)
    data.qpos[0], data.ctrl[0] = np.pi / 2, 100.0
    mujoco.mj_forward(arm, data)
    assert (arm.njnt, arm.nu, arm.joint(0).name) == (1, 1, joint)
    assert data.qfrc_bias[0] == pytest.approx(moment * 9.81, rel=1e-5)  # six digits in MJCF
    assert data.qfrc_actuator[0] == 9.0


def test_a_capture_of_seven_joints_becomes_a_recording_of_one() -> None:
    names = ("q", "qd", "tau_measured", "tau_command")
    of_all = {name: 10 * i + np.arange(7) + np.zeros((30, 1)) for i, name in enumerate(names)}
    packed = io.BytesIO()
    np.savez(packed, time=0.03 * np.arange(30), **of_all)
    run = forearm.recording("run", packed.getvalue(), "joint", 2)
    for found, wanted in ((run.position, 2), (run.effort, 22), (run.command, 32)):
        np.testing.assert_array_equal(found, np.full((30, 1), wanted))
    assert run.stamp_ns[1] == 30_000_000
