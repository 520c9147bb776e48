"""Recordings: what was written is what is read, also after the writer was killed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfm.core import Command, CommandKind, ObjectTrack, RecordingError, Trajectory
from gfm.recording import RecordingWriter, read_recording, write_recording

JOINTS = ("shoulder", "elbow")


def trajectory(steps: int = 50, *, kind: CommandKind = CommandKind.POSITION) -> Trajectory:
    rng = np.random.default_rng(3)
    stamps = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(steps, dtype=np.int64)
    poses = rng.normal(size=(5, 4))
    return Trajectory(
        name="swing",
        joint_names=JOINTS,
        stamp_ns=stamps,
        position=rng.normal(size=(steps, 2)),
        velocity=rng.normal(size=(steps, 2)),
        effort=rng.normal(size=(steps, 2)),
        command_kind=kind,
        command_stamp_ns=stamps[::5],
        command=rng.normal(size=(len(stamps[::5]), 2)),
        requested=rng.normal(size=(len(stamps[::5]), 2)),
        servo_gain={"elbow": 0.25},
        object_track=ObjectTrack(
            stamp_ns=stamps[:5],
            position=rng.normal(size=(5, 3)),
            quaternion=poses / np.linalg.norm(poses, axis=1, keepdims=True),
        ),
        metadata={"run": "r1", "software": "test"},
    )


def arrays(recording: Trajectory) -> dict[str, np.ndarray | None]:
    return {k: v for k, v in vars(recording).items() if isinstance(v, np.ndarray | None)}


@pytest.mark.parametrize("kind", list(CommandKind))
def test_what_was_written_is_what_is_read(tmp_path: Path, kind: CommandKind) -> None:
    path = tmp_path / "swing.mcap"
    write_recording(path, trajectory(kind=kind))
    back = read_recording(path)
    for name, value in arrays(trajectory(kind=kind)).items():
        np.testing.assert_array_equal(getattr(back, name), value, err_msg=name)
    assert back.name == "swing"
    assert back.command_kind == kind
    assert back.servo_gain == {"elbow": 0.25}
    assert back.metadata == {"run": "r1", "software": "test"}
    assert back.object_track is not None
    assert trajectory().object_track is not None
    np.testing.assert_allclose(
        back.object_track.quaternion, trajectory().object_track.quaternion, rtol=1e-15
    )
    assert [p.name for p in tmp_path.iterdir()] == ["swing.mcap"]


@settings(max_examples=25, deadline=None)
@given(stamp_ns=st.integers(0, 2**31 * 10**9 - 10**10), value=st.floats(-1e6, 1e6))
def test_stamps_and_values_survive_exactly(
    tmp_path_factory: pytest.TempPathFactory, stamp_ns: int, value: float
) -> None:
    path = tmp_path_factory.mktemp("recording") / "a.mcap"
    with RecordingWriter(path) as writer:
        for step in range(10):
            writer.write_state(stamp_ns + step, ["j"], np.array([value]))
        writer.write_command(command([value], stamp_ns))
    back = read_recording(path)
    assert back.stamp_ns.tolist() == [stamp_ns + step for step in range(10)]
    assert back.position[0, 0] == back.command[0, 0] == value
    assert back.velocity is back.effort is None


def command(values: list[float], stamp_ns: int, names: tuple[str, ...] = ("j",)) -> Command:
    return Command(
        kind=CommandKind.VELOCITY, joint_names=names, values=np.array(values), stamp_ns=stamp_ns
    )


def test_joints_are_matched_by_name_not_by_place(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        for step in range(10):
            names, values = ("a", "b"), [1.0, 2.0]
            if step % 2:
                names, values = ("b", "a"), [2.0, 1.0]
            writer.write_state(step, names, np.array(values))
        writer.write_command(command([20.0, 10.0], 0, ("b", "a")))
    back = read_recording(path)
    assert back.joint_names == ("a", "b")
    assert (back.position == [1.0, 2.0]).all()
    assert back.command.tolist() == [[10.0, 20.0]]


def test_a_joint_without_commands_is_listed(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        for step in range(10):
            writer.write_state(step, ("cart", "pole"), np.zeros(2))
        writer.write_command(command([3.0], 0, ("cart",)))
    back = read_recording(path)
    assert back.command.tolist() == [[3.0, 0.0]]
    assert back.metadata["uncommanded_joints"] == "pole"


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
def test_a_file_cut_anywhere_is_refused_and_never_crashes(tmp_path: Path) -> None:
    write_recording(tmp_path / "whole.mcap", trajectory(steps=200))
    whole = (tmp_path / "whole.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    for size in [*range(8, len(whole) - 40, 997), len(whole) - 40]:
        cut.write_bytes(whole[:size])
        with pytest.raises(RecordingError, match="cut off or damaged after"):
            read_recording(cut)


def test_flipped_bytes_are_refused(tmp_path: Path) -> None:
    write_recording(tmp_path / "whole.mcap", trajectory(steps=200))
    whole = bytearray((tmp_path / "whole.mcap").read_bytes())
    middle = len(whole) // 3
    whole[middle : middle + 40] = bytes(40)
    (tmp_path / "bad.mcap").write_bytes(whole)
    with pytest.raises(RecordingError, match="damaged"):
        read_recording(tmp_path / "bad.mcap")


def test_nothing_is_left_when_a_whole_trajectory_cannot_be_written(tmp_path: Path) -> None:
    absurd = Trajectory(**{**vars(trajectory()), "stamp_ns": -trajectory().stamp_ns[::-1] * 5})
    with pytest.raises(Exception, match=r"."):
        write_recording(tmp_path / "a.mcap", absurd)
    assert list(tmp_path.iterdir()) == []


def record_until_interrupted(path: Path) -> None:
    with RecordingWriter(path) as writer:
        for step in range(20):
            writer.write_state(step, ("j",), np.zeros(1))
            writer.write_command(command([0.0], step))
        raise KeyboardInterrupt


def test_an_error_while_recording_keeps_what_was_recorded(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        record_until_interrupted(tmp_path / "a.mcap")
    assert len(read_recording(tmp_path / "a.mcap.part").stamp_ns) == 20
