"""Recordings that a command refuses: one line, exit status 2, nothing written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from bad_inputs.making import recording

from gfm.api.refusals import (
    check_held_out,
    check_one_robot,
    check_some_motion,
    check_usable,
)
from gfm.cli import main
from gfm.core import CommandKind, RecordingError, Trajectory
from gfm.recording.writer import write_recording

EPOCH_NS = 1_700_000_000_000_000_000
MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body>
      <joint name="a" axis="0 1 0" range="-2 2" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/>
      <body pos="0 0 -0.3">
        <joint name="b" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.5"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a" joint="a" kp="20" kv="1"/>
    <position name="b" joint="b" kp="20" kv="1"/>
  </actuator>
</mujoco>
"""


def specs() -> dict[CommandKind, mujoco.MjSpec]:
    return {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}


def files(*recordings: Trajectory) -> list[tuple[Path, Trajectory]]:
    return [(Path(f"{one.name}.mcap"), one) for one in recordings]


def without(one: Trajectory, joint: int) -> Trajectory:
    keep = [1 - joint]
    return replace(
        one,
        joint_names=(one.joint_names[1 - joint],),
        position=one.position[:, keep],
        command=one.command[:, keep],
    )


def with_joint_still(one: Trajectory, joint: int) -> Trajectory:
    position = one.position.copy()
    position[:, joint] = position[0, joint]
    return replace(one, position=position)


def test_good_recordings_are_used():
    check_usable(specs(), files(recording("r0", 0), recording("r1", 1)), files(recording("r2", 2)))
    check_usable(specs(), files(recording("r0", 0)), [])


def test_held_out_measurements_that_a_fit_sees_are_refused_under_any_name():
    seen, other = recording("seen", 0), recording("other", 1)
    renamed = replace(seen, name="renamed", stamp_ns=seen.stamp_ns + 10**15)
    with pytest.raises(RecordingError, match=r"^renamed.mcap: is the same as seen.mcap: 100 %"):
        check_held_out(files(other, seen), files(renamed))
    check_held_out(files(seen), files(other))
    check_held_out(files(seen, renamed), [])


def test_pieces_of_one_recording_that_overlap_are_refused():
    whole = recording("whole", 0)
    first = replace(whole, stamp_ns=whole.stamp_ns[:200], position=whole.position[:200])
    rest = replace(whole, stamp_ns=whole.stamp_ns[150:], position=whole.position[150:])
    with pytest.raises(RecordingError, match="49 measurements of the motion"):
        check_held_out(files(first), files(rest))


def test_recordings_that_name_other_robots_are_refused():
    one = recording("one", 0, metadata={"robot": "left"})
    unnamed = recording("unnamed", 1)
    other = recording("other", 2, metadata={"robot": "right"})
    check_one_robot(files(one, unnamed))
    with pytest.raises(RecordingError, match=r"^other.mcap: is of robot 'right'; .*'left'$"):
        check_one_robot(files(unnamed, one, other))


def test_positions_that_never_change_anywhere_are_refused():
    still = [recording(f"r{i}", i, position=np.zeros((300, 2))) for i in range(2)]
    with pytest.raises(RecordingError, match=r"^r0.mcap: position: never changes, on no joint"):
        check_some_motion(files(*still))
    check_some_motion(files(*still, recording("moves", 3)))


SPOILT = {
    "position_degrees": (
        lambda one: replace(one, position=np.degrees(one.position)),
        "spoilt.mcap: position of a: is ",
        "(are the measurements in degrees?)",
    ),
    "all_degrees": (
        lambda one: replace(
            one, position=np.degrees(one.position), command=np.degrees(one.command)
        ),
        "spoilt.mcap: position of a: reaches ",
        "degrees? scale them by 0.0174533)",
    ),
    "joint_still": (
        lambda one: with_joint_still(one, 1),
        "spoilt.mcap: position of b: never changes",
        "",
    ),
    "joint_missing": (
        lambda one: without(one, 1),
        "spoilt.mcap: lacks joint b, which good has; expected the same joints in all recordings",
        "",
    ),
    "other_robot": (
        lambda one: replace(one, joint_names=("a", "c")),
        "spoilt.mcap: joints a, c; expected those of good: a, b",
        "(one robot at a time)",
    ),
    "other_kind": (
        lambda one: replace(one, command_kind=CommandKind.VELOCITY),
        "spoilt.mcap: velocity commands; expected position commands: those the models' actuators",
        "",
    ),
    "milliseconds": (
        lambda one: replace(
            one,
            stamp_ns=one.stamp_ns[0] + (one.stamp_ns - one.stamp_ns[0]) // 1000,
            command_stamp_ns=one.stamp_ns[0] + (one.stamp_ns - one.stamp_ns[0]) // 1000,
        ),
        "spoilt.mcap: stamps of the measurements: 1e+05 measurements per second",
        "time.scale)",
    ),
    "zero_effort": (
        lambda one: replace(one, effort=np.zeros((300, 2))),
        "spoilt.mcap: effort: is 0 throughout",
        "or an empty field where nothing measures them",
    ),
    "copy": (
        lambda one: replace(recording(one.name, 0), metadata={"copied": "yes"}),
        "spoilt.mcap: is the same as ",
        "errors on what was fitted prove nothing",
    ),
}


@pytest.mark.parametrize("case", SPOILT)
def test_the_command_says_it_in_one_line_and_writes_nothing(tmp_path, capsys, case):
    spoil, begin, end = SPOILT[case]
    model = tmp_path / "model.xml"
    model.write_text(MODEL)
    good, spoilt = tmp_path / "good.mcap", tmp_path / "spoilt.mcap"
    write_recording(good, recording("good", 0))
    write_recording(spoilt, spoil(recording("spoilt", 1)))
    before = sorted(tmp_path.iterdir())
    argv = ["diagnose", str(good), "--holdout", str(spoilt), "--model", str(model)]
    assert main([*argv, "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: {tmp_path}/{begin}")
    assert line.endswith(end)
    assert sorted(tmp_path.iterdir()) == before


def test_a_joint_that_only_the_others_have_is_named(tmp_path, capsys):
    model = tmp_path / "model.xml"
    model.write_text(MODEL)
    paths = [tmp_path / f"r{i}.mcap" for i in range(2)]
    write_recording(paths[0], without(recording("r0", 0), 1))
    write_recording(paths[1], recording("r1", 1))
    argv = ["diagnose", *map(str, paths), "--model", str(model), "--out", str(tmp_path / "out")]
    assert main(argv) == 2
    assert "r1.mcap: has joint b, which r0 lacks; expected" in capsys.readouterr().err
