"""`gfm doctor`: whatever is wrong between a model and recordings is one line with what to do."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import gfm
from gfm.api.doctor.duration import candidates
from gfm.cli import main
from gfm.core import CommandKind, Trajectory
from gfm.core.trajectory import UNCOMMANDED
from gfm.recording import write_recording
from gfm.report.checks import Level

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody><body>
    <joint name="shoulder" axis="0 1 0" damping="0.5" armature="0.05" range="-2 2" limited="true"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/>
    <body pos="0 0 -0.3">
      <joint name="elbow" axis="0 1 0" damping="0.5" armature="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5"/>
    </body>
  </body></worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="30" kv="1" ctrlrange="-1.9 1.9"/>
    <position name="elbow" joint="elbow" kp="30" kv="1"/>
  </actuator>
</mujoco>
"""
JOINTS = ("shoulder", "elbow")


@pytest.fixture(scope="module")
def runs() -> list[Trajectory]:
    """Returns two recordings of the arm as its model says, 6 s each at 100 Hz."""
    return [recorded(seed) for seed in range(2)]


def recorded(seed: int) -> Trajectory:
    model = mujoco.MjModel.from_xml_string(ARM)
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    time_s = 0.01 * np.arange(600)
    phases = rng.uniform(0.0, 6.0, (2, 2))
    command = 0.5 * np.sin(2 * np.pi * 0.4 * time_s[:, None] + phases[0])
    command += 0.2 * np.sin(2 * np.pi * 1.7 * time_s[:, None] + phases[1])
    data.qpos[:] = command[0]
    position = []
    for setpoint in command:
        position.append(data.qpos.copy())
        data.ctrl[:] = setpoint
        mujoco.mj_step(model, data, nstep=5)
    stamp_ns = np.round(1e9 * time_s).astype(np.int64)
    return Trajectory(
        name=f"run{seed}",
        joint_names=JOINTS,
        stamp_ns=stamp_ns,
        position=np.array(position) + rng.normal(0.0, 1e-4, command.shape),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=command,
    )


def spec(xml: str = ARM) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(xml)


def told(found, name: str, level: Level) -> str:
    """Returns what the lines of one check say at a level, with what to do."""
    lines = [one for one in found.checks if (one.name, one.level) == (name, level)]
    return "\n".join(f"{one.found} -> {one.advice}" for one in lines)


def names(found, level: Level) -> set[str]:
    return {one.name for one in found.checks if one.level is level}


def test_a_model_and_its_own_recordings_are_in_order(runs):
    found = gfm.doctor(spec(), runs[:1], holdout=runs[1:])
    assert found.ok
    assert names(found, Level.REFUSE) == set()
    assert names(found, Level.WARN) <= {"what can be found"}
    assert told(found, "joint names", Level.OK) == "all 2 in the model: shoulder, elbow -> "
    assert "6.0 s in 1 recordings to learn from, 6.0 s in 1 held out" in str(found)
    assert "a diagnosis can begin" in repr(found)


def test_what_is_refused_here_a_diagnosis_refuses_and_nothing_else(runs):
    spoilt = [
        [replace(run, joint_names=("shoulder", "elbow_joint")) for run in runs],
        [replace(run, position=np.degrees(run.position)) for run in runs],
        [replace(run, command_kind=CommandKind.VELOCITY) for run in runs],
        [runs[0], replace(runs[0], name="again")],
        [replace(run, position=0.0 * run.position) for run in runs],
        runs,
    ]
    for given in spoilt:
        found = gfm.doctor(spec(), given[:1], holdout=given[1:])
        try:
            gfm.rollout_error(spec(), given[0])
            gfm.diagnose(spec(), given[0], holdout=given[1], minutes=1e-9)
            refused = False
        except gfm.core.BadInputError:
            refused = True
        assert found.ok is not refused, str(found)


@pytest.mark.parametrize(
    ("called", "advice"),
    [
        ("elbow_joint", "is it elbow_joint as elbow?"),
        ("Elbow", "is it Elbow as elbow?"),
        ("ellbow", "is it ellbow as elbow?"),
        ("j2", "name them as the model does (shoulder, elbow)"),
    ],
)
def test_a_name_that_the_model_lacks_is_told_with_the_likely_one(runs, called, advice):
    given = [replace(run, joint_names=("shoulder", called)) for run in runs]
    found = gfm.doctor(spec(), given)
    words = told(found, "joint names", Level.REFUSE)
    assert words.startswith(f"not in the position model: {called} -> {advice}")
    assert "units and signs" in names(found, Level.OK)  # the other joint is looked at all the same


def test_a_joint_that_is_driven_and_not_recorded_is_told(runs):
    given = [run.with_joints(["shoulder"]) for run in runs]
    words = told(gfm.doctor(spec(), given), "joint names", Level.WARN)
    assert words.startswith("driven in the position model, never recorded: elbow: taken to stand")


def test_a_gripper_that_is_measured_and_not_in_the_model_is_left_out(runs):
    def with_gripper(run: Trajectory) -> Trajectory:
        zeros = np.zeros((len(run.stamp_ns), 1))
        return replace(
            run,
            joint_names=(*JOINTS, "gripper"),
            position=np.hstack([run.position, zeros]),
            command=np.hstack([run.command, zeros]),
            metadata={UNCOMMANDED: "gripper"},
        )

    found = gfm.doctor(spec(), [with_gripper(run) for run in runs])
    assert "gripper: left out" in told(found, "joint names", Level.WARN)
    assert found.ok


def test_positions_in_degrees_are_refused_with_what_to_do(runs):
    given = [replace(run, position=np.degrees(run.position)) for run in runs]
    words = told(gfm.doctor(spec(), given), "units and signs", Level.REFUSE)
    assert "run0: " in words
    assert "in degrees" in words


def test_commands_of_another_kind_are_refused(runs):
    motors = ARM.replace("<position", "<motor").replace(' kp="30" kv="1"', "")
    words = told(gfm.doctor(spec(motors), runs), "kind of command", Level.REFUSE)
    assert words == (
        "position in run0, run1; the model's actuators take effort -> "
        "give one more --model, whose actuators take position commands"
    )


def test_a_command_that_copies_the_measurement_is_told(runs):
    given = [replace(run, command=run.position) for run in runs]
    words = told(gfm.doctor(spec(), given), "quality", Level.WARN)
    assert "command equals measurement 100 %" in words
    assert "record what the robot was told" in words


def test_gaps_and_clocks_that_jump_are_told(runs):
    late = runs[0].stamp_ns.copy()
    late[300:] += 500_000_000
    jumped = replace(runs[0], stamp_ns=late, command_stamp_ns=late)
    kept = np.r_[0:300, 360:600]
    lost = replace(runs[1], stamp_ns=runs[1].stamp_ns[kept], position=runs[1].position[kept])
    words = told(gfm.doctor(spec(), [jumped, lost]), "quality", Level.WARN)
    assert "clock jumps by 0.510 s (run0)" in words
    assert "longest gap 0.610 s (run1)" in words


def test_motion_beyond_a_joint_s_range_is_told(runs):
    narrow = ARM.replace('range="-2 2"', 'range="-0.4 0.4"')
    words = told(gfm.doctor(spec(narrow), runs), "joint ranges", Level.WARN)
    assert words.startswith("shoulder went from -0.")
    assert "its range is -0.4 to 0.4 rad -> widen the range" in words


def test_commands_that_the_model_would_clip_are_told(runs):
    narrow = ARM.replace('ctrlrange="-1.9 1.9"', 'ctrlrange="-0.4 0.4"')
    words = told(gfm.doctor(spec(narrow), runs), "control ranges", Level.WARN)
    assert words.startswith("shoulder was told -0.")
    assert "its actuator takes -0.4 to 0.4: the model clips the rest" in words


def test_parts_that_touch_in_recorded_poses_are_told(runs):
    ball = '<worldbody><geom name="ball" size="0.05" pos="0 0 -0.15"/><body>'
    found = gfm.doctor(spec(ARM.replace("<worldbody><body>", ball)), runs)
    words = told(found, "contacts", Level.WARN)
    assert "and world touch in " in words
    assert "exclude the pair in MJCF" in words
    assert told(gfm.doctor(spec(), runs), "contacts", Level.OK).startswith("nothing touches in 100")


@pytest.mark.parametrize(("every", "level"), [(2, Level.OK), (5, Level.WARN), (20, Level.REFUSE)])
def test_few_measurements_a_second_are_told(runs, every, level):
    given = [
        replace(run, stamp_ns=run.stamp_ns[::every], position=run.position[::every]) for run in runs
    ]
    assert f"measured {100 / every:.3g} times a second" in told(
        gfm.doctor(spec(), given), "rates", level
    )


def test_the_same_measurements_under_another_name_are_refused(runs):
    found = gfm.doctor(spec(), [runs[0], replace(runs[0], name="again")])
    assert "run0 and again: 100 % of the motion" in told(found, "same measurements", Level.REFUSE)


def test_a_joint_that_stood_still_cannot_show_anything(runs):
    still = [
        replace(
            run,
            position=np.stack([run.position[:, 0], 1e-4 * run.position[:, 1]], axis=1),
            command=run.command * [1.0, 0.0],
        )
        for run in runs
    ]
    found = gfm.doctor(spec(), still)
    assert "not anything on elbow" in told(found, "what can be found", Level.WARN)
    details = [words for one in found.checks for words in one.details]
    assert "anything on elbow: moved over less than 0.02 rad" in details


def test_what_motions_cannot_show_comes_with_the_command_that_proposes_them(runs, tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    small = [replace(r, position=0.2 * r.position, command=0.2 * r.command) for r in runs]
    words = told(gfm.doctor(path, small), "what can be found", Level.WARN)
    assert f"gfm excite --model {path} --for " in words
    assert words.count("gfm excite") == len(set(words.splitlines()))


def test_every_pair_of_joints_is_a_candidate_of_what_couples_them():
    one, two, three = (candidates(joints) for joints in (1, 2, 3))
    assert (three - two) - (two - one) == 1


def test_a_file_that_cannot_be_read_does_not_hide_the_others(runs, tmp_path):
    good, bad = tmp_path / "good.mcap", tmp_path / "bad.mcap"
    write_recording(good, runs[0])
    bad.write_bytes(b"not MCAP at all")
    found = gfm.doctor(spec(), tmp_path)
    assert f"{bad}: not an MCAP file" in told(found, "recordings", Level.REFUSE)
    assert "joint names" in names(found, Level.OK)


def test_recordings_are_looked_at_even_where_the_model_does_not_load(runs):
    found = gfm.doctor("none.xml", runs)
    words = told(found, "model", Level.REFUSE)
    assert words == "model none.xml: no such file -> expected MJCF or URDF"
    assert "rates" in names(found, Level.OK)


def test_the_command_prints_a_table_or_json_and_its_status_tells(runs, tmp_path, capsys):
    model, run = tmp_path / "arm.xml", tmp_path / "run.mcap"
    model.write_text(ARM)
    write_recording(run, runs[0])
    assert main(["doctor", str(model), str(run)]) == 0
    assert "a diagnosis can begin" in capsys.readouterr().out
    write_recording(run, replace(runs[0], joint_names=("shoulder", "j2")))
    assert main(["doctor", str(model), str(run), "--json"]) == 2
    document = json.loads(capsys.readouterr().out)
    assert (document["schema"], document["ok"]) == ("gfm.doctor/1", False)
    refused = [one["name"] for one in document["checks"] if one["level"] == "refuse"]
    assert refused == ["joint names"]
    assert [path.name for path in Path(tmp_path).iterdir()] == ["arm.xml", "run.mcap"]


def test_a_notebook_s_table_escapes_names(runs):
    given = [replace(run, joint_names=("shoulder", "<img>")) for run in runs]
    assert "<img>" not in gfm.doctor(spec(), given)._repr_html_()
