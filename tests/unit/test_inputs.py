"""Models and recordings that commands read: kinds, joints, splits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.api.models import command_kind, load_specs
from gfm.api.provenance import provenance
from gfm.api.recordings import check_together, cut_in_two, read_recordings, split
from gfm.core import BadInputError, CommandKind, ConfigError, RecordingError, Trajectory
from gfm.recording.writer import write_recording

MODELS = Path(__file__).parents[2] / "models"
EPOCH_NS = 1_700_000_000_000_000_000
PENDULUM = """
<mujoco>
  <worldbody>
    <body><joint name="a" axis="0 1 0"/><geom size="0.1" mass="1"/>
      <body><joint name="b" axis="0 1 0"/><geom size="0.1" mass="1"/></body>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>
"""


def model(actuators: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(PENDULUM.format(actuators=actuators))


def trajectory(name: str = "one", joints: tuple[str, ...] = ("a", "b")) -> Trajectory:
    """Returns 2 s in which every number tells its row and its joint."""
    ticks = np.arange(200)
    columns = np.arange(1.0, 1.0 + len(joints)) * 1e-3
    return Trajectory(
        name=name,
        joint_names=joints,
        stamp_ns=EPOCH_NS + ticks * 10_000_000,
        position=ticks[:, None] * columns,
        velocity=ticks[:, None] * columns + 1.0,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=EPOCH_NS + ticks[::4] * 10_000_000 - 3_000_000,
        command=ticks[::4, None] * columns,
    )


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("sawyer_position.xml", CommandKind.POSITION),
        ("sawyer_velocity.xml", CommandKind.VELOCITY),
        ("xl330_pendulum.xml", CommandKind.POSITION),
        ("double_pendulum_c1.xml", CommandKind.EFFORT),
        ("double_pendulum_a0.xml", CommandKind.EFFORT),
    ],
)
def test_the_kind_of_command_is_seen_in_the_actuators(file, kind):
    assert list(load_specs([MODELS / file])) == [kind]


def test_models_of_different_kinds_go_together():
    specs = load_specs([MODELS / "sawyer_velocity.xml", MODELS / "sawyer_position.xml"])
    assert set(specs) == {CommandKind.POSITION, CommandKind.VELOCITY}


def test_two_models_of_one_kind_are_refused():
    path = MODELS / "sawyer_position.xml"
    with pytest.raises(ConfigError, match="both have position actuators"):
        load_specs([path, path])


@pytest.mark.parametrize("damping", ['dampratio="1"', 'kv="0.7"'])
def test_a_servo_keeps_its_damping_when_inertia_is_added(tmp_path, damping):
    path = tmp_path / "arm.xml"
    path.write_text(PENDULUM.format(actuators=f'<position name="b" joint="b" kp="5" {damping}/>'))
    before = mujoco.MjModel.from_xml_path(str(path)).actuator_biasprm[0, 2]
    (spec,) = load_specs([path]).values()
    spec.joint("b").armature += 0.3
    assert spec.compile().actuator_biasprm[0, 2] == before < 0.0


def test_a_robot_that_floats_is_refused(tmp_path):
    floating = PENDULUM.replace(
        "<body><joint", '<body name="trunk"><freejoint/><geom size="0.1"/><body><joint', 1
    ).replace("</worldbody>", "</body></worldbody>")
    path = tmp_path / "dog.xml"
    path.write_text(floating.format(actuators='<position name="b" joint="b" kp="1"/>'))
    with pytest.raises(ConfigError, match=r"dog\.xml: trunk, which carries b, floats"):
        load_specs([path])


@pytest.mark.parametrize(
    ("actuators", "message"),
    [
        ("", "m: no actuator drives a joint; expected one"),
        (
            '<motor name="a" joint="a"/><position name="b" joint="b" kp="1"/>',
            r"m: actuators a \(effort\), b \(position\); expected one kind of command",
        ),
        (
            '<general name="a" joint="a" gainprm="2" biastype="affine" biasprm="0 -1 0"/>',
            "m: actuator a is no position servo, velocity servo or motor",
        ),
        (
            '<intvelocity name="a" joint="a" kp="1" actrange="-1 1"/>',
            "m: actuator a is no position servo, velocity servo or motor",
        ),
        (
            '<damper name="b" joint="b" kv="1" ctrlrange="0 1"/>',
            "m: actuator b is no position servo, velocity servo or motor",
        ),
    ],
)
def test_actuators_that_say_nothing_clear_are_refused(actuators, message):
    with pytest.raises(ConfigError, match=message):
        command_kind(model(actuators), "m")


@pytest.mark.parametrize("content", [None, "<mujoco><worldbody>", "not XML"])
def test_a_model_that_cannot_be_loaded_is_one_line(tmp_path, content):
    path = tmp_path / "model.xml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(BadInputError) as refused:
        load_specs([path])
    assert str(refused.value).startswith(f"model {path}: ")
    assert "\n" not in str(refused.value)


def test_joints_come_in_the_order_of_the_first_recording(tmp_path):
    one, other = trajectory("one"), trajectory("other", joints=("b", "a"))
    for each in (one, other):
        write_recording(tmp_path / f"{each.name}.mcap", each)
    first, second = read_recordings([tmp_path / "one.mcap", tmp_path / "other.mcap"])
    assert first.joint_names == second.joint_names == ("a", "b")
    np.testing.assert_allclose(second.position, other.position[:, ::-1])
    np.testing.assert_allclose(second.velocity, other.velocity[:, ::-1])
    np.testing.assert_allclose(second.command, other.command[:, ::-1])


def test_recordings_of_different_robots_are_refused(tmp_path):
    for each in (trajectory("one"), trajectory("other", joints=("a", "c"))):
        write_recording(tmp_path / f"{each.name}.mcap", each)
    with pytest.raises(RecordingError, match=r"other.mcap: joints a, c; expected those of one"):
        read_recordings([tmp_path / "one.mcap", tmp_path / "other.mcap"])


@pytest.mark.parametrize(
    ("actuators", "recording", "message"),
    [
        ('<motor name="a" joint="a"/>', trajectory(), "position commands; expected effort"),
        (
            '<position name="a" joint="a" kp="1"/>',
            trajectory(),
            "no actuator of the model is called b.*; expected names from the model's actuators: a$",
        ),
        (
            '<position name="a" joint="a" kp="1"/>',
            trajectory(joints=("a", "c")),
            "no joint of the model is called c.*; expected names from the model's joints: a, b$",
        ),
    ],
)
def test_a_recording_that_does_not_fit_the_model_is_refused(actuators, recording, message):
    spec = mujoco.MjSpec.from_string(PENDULUM.format(actuators=actuators))
    kind = command_kind(spec.compile(), "m")
    with pytest.raises(RecordingError, match=message):
        check_together({kind: spec}, [(Path("r.mcap"), recording)])


def test_the_last_of_several_recordings_is_held_out():
    recordings = [trajectory("one"), trajectory("two"), trajectory("three")]
    training, held_out, note = split(recordings)
    assert [r.name for r in training] == ["one", "two"]
    assert [r.name for r in held_out] == ["three"]
    assert "three" in note


def test_the_end_of_a_single_recording_is_held_out():
    training, held_out, note = split([trajectory()])
    assert training[0].duration_s == pytest.approx(1.4, abs=0.02)
    assert held_out[0].duration_s == pytest.approx(0.6, abs=0.02)
    assert "30 %" in note


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_a_cut_loses_and_doubles_no_measurement(share):
    whole = trajectory()
    first, last = cut_in_two(whole, share)
    np.testing.assert_array_equal(np.concatenate([first.position, last.position]), whole.position)
    np.testing.assert_array_equal(np.concatenate([first.stamp_ns, last.stamp_ns]), whole.stamp_ns)


def test_the_command_in_force_at_the_cut_stays_in_force_however_old_it_is():
    whole = trajectory()
    sparse = replace(whole, command_stamp_ns=whole.command_stamp_ns[:2], command=whole.command[:2])
    _, last = cut_in_two(sparse, 0.9)
    np.testing.assert_array_equal(last.command, sparse.command[1:])
    assert last.command_stamp_ns[0] < last.stamp_ns[0]


def test_provenance_tells_files_apart_by_content(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"abc")
    told = provenance({"recording": [path]}, 7, ["gfm", "diagnose", "a file"])
    assert told["files"] == [
        {
            "role": "recording",
            "path": str(path),
            "sha256": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
        }
    ]
    assert told["seed"] == 7
    assert told["command"] == "gfm diagnose 'a file'"
    assert {"gfm", "mujoco", "numpy", "scipy"} <= set(told["versions"])
