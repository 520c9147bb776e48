"""`gfm recording cut` and `salvage`: parts of recordings, and what is readable of one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gfm.core import Command, CommandKind
from gfm.recording import RecordingWriter, read_recording
from gfm.recording.raw import read_raw
from swings import BEGIN_NS, JOINTS, STEPS, left_by_a_crash, names, run, swing


def test_a_cut_has_every_topic_and_the_command_in_force(recorded: Path, tmp_path: Path) -> None:
    out = tmp_path / "part.mcap"
    assert run("cut", recorded, "--from", "1.02", "--to", "2", "--out", out) == 0
    whole, part = read_recording(recorded), read_recording(out)
    np.testing.assert_array_equal(part.stamp_ns, whole.stamp_ns[102:200])
    np.testing.assert_array_equal(part.position, whole.position[102:200])
    np.testing.assert_array_equal(part.command_stamp_ns, whole.command_stamp_ns[20:40])
    np.testing.assert_array_equal(part.requested, whole.requested[20:40])
    assert part.object_track is not None
    assert len(part.object_track.stamp_ns) == 9
    assert part.metadata == {
        **whole.metadata,
        "cut_from": "swing.mcap from 1.02 s to 2 s",
    }


def test_two_cuts_that_meet_are_the_whole(recorded: Path, tmp_path: Path) -> None:
    run("cut", recorded, "--to", "2", "--out", tmp_path / "first.mcap")
    run("cut", recorded, "--from", "2", "--out", tmp_path / "last.mcap")
    first, last = (read_recording(tmp_path / f"{name}.mcap") for name in ("first", "last"))
    joined = np.concatenate([first.position, last.position])
    np.testing.assert_array_equal(joined, swing().position)


def test_a_cut_of_a_cut_says_so(recorded: Path, tmp_path: Path) -> None:
    run("cut", recorded, "--from", "1", "--out", tmp_path / "b.mcap")
    run("cut", tmp_path / "b.mcap", "--to", "1", "--out", tmp_path / "c.mcap")
    part = read_recording(tmp_path / "c.mcap")
    assert part.metadata["cut_from"] == (
        "swing.mcap from 1 s to the end; of that b.mcap from the beginning to 1 s"
    )
    np.testing.assert_array_equal(part.stamp_ns, swing().stamp_ns[100:200])


def test_what_lasts_is_logged_when_the_part_begins(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        writer.write_description(BEGIN_NS, "<robot/>")
        for step in range(20):
            writer.write_state(BEGIN_NS + step * 10**8, JOINTS, np.zeros(2))
    assert run("cut", tmp_path / "a.mcap", "--from", "1", "--out", tmp_path / "b.mcap") == 0
    part = read_raw(tmp_path / "b.mcap").by_topic()
    assert [m.log_time for m in part["/robot_description"]] == [BEGIN_NS + 10**9]
    assert min(m.log_time for m in part["/joint_states"]) == BEGIN_NS + 10**9


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (("--from", "2", "--to", "1"), "expected an end after the beginning"),
        (("--from", "nan"), "expected an end after the beginning"),
        (("--from", "5"), "has nothing from 5 s to inf s; expected a part of 0 s to 3.990 s"),
    ],
)
def test_a_cut_of_nothing_is_refused(
    recorded: Path, tmp_path: Path, capsys, times: tuple[str, ...], words: str
) -> None:
    assert run("cut", recorded, *times, "--out", tmp_path / "part.mcap") == 2
    assert words in capsys.readouterr().err
    assert names(tmp_path) == ["swing.mcap"]


# Salvage


@pytest.mark.parametrize("name", ["crash.mcap", "crash_crashed_1.mcap"])
def test_what_a_crash_left_becomes_a_whole_recording(tmp_path: Path, capsys, name: str) -> None:
    part = left_by_a_crash(tmp_path / name)
    before = part.read_bytes()
    assert run("salvage", part) == 0
    out = tmp_path / name.replace(".mcap", "_salvaged.mcap")
    saved = read_recording(out)
    assert saved.duration_s > 3.0
    assert saved.metadata["salvaged_from"] == part.name
    assert saved.requested is not None
    assert f"{len(saved.stamp_ns)} measurements" in capsys.readouterr().out
    assert part.read_bytes() == before


def test_a_file_cut_anywhere_is_saved_or_has_no_measurement(recorded: Path, capsys) -> None:
    whole = recorded.read_bytes()
    measured = read_recording(recorded)
    counts = []
    for number, size in enumerate(range(8, len(whole) - 40, 2503)):
        cut = recorded.with_name(f"cut{number}.mcap")
        cut.write_bytes(whole[:size])
        if run("salvage", cut) == 2:
            counts.append(0)
            assert "nothing is readable on /joint_states" in capsys.readouterr().err
            continue
        raw = read_raw(cut.with_name(f"cut{number}_salvaged.mcap"))
        assert raw.complete
        stamps = raw.stamps_ns("/joint_states", raw.by_topic()["/joint_states"])
        np.testing.assert_array_equal(stamps, measured.stamp_ns[: len(stamps)])
        counts.append(len(stamps))
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] > 0.9 * STEPS


def test_what_lies_behind_a_damaged_chunk_is_saved(recorded: Path, capsys) -> None:
    content = bytearray(recorded.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 20] = bytes(20)
    recorded.with_name("bad.mcap").write_bytes(content)
    assert run("salvage", recorded.with_name("bad.mcap")) == 0
    assert "lost: 1 damaged chunks" in capsys.readouterr().out
    saved = read_recording(recorded.with_name("bad_salvaged.mcap"))
    assert saved.stamp_ns[-1] == swing().stamp_ns[-1]
    assert 0.8 * STEPS < len(saved.stamp_ns) < STEPS
    assert saved.metadata["salvaged_without"].startswith("1 damaged chunks")


def test_a_whole_recording_needs_no_salvage(recorded: Path, capsys) -> None:
    assert run("salvage", recorded) == 2
    assert "is whole; expected a file that was cut off" in capsys.readouterr().err


def test_a_part_that_only_lacks_its_name_loses_nothing(recorded: Path, capsys) -> None:
    part = recorded.rename(recorded.with_name("swing.mcap.part"))
    assert run("salvage", part) == 0
    assert "lost: nothing that is in the file" in capsys.readouterr().out
    saved = read_recording(recorded.with_name("swing_salvaged.mcap"))
    np.testing.assert_array_equal(saved.position, swing().position)


def test_commands_of_which_one_half_is_lost_are_left_out(tmp_path: Path, capsys) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap")
    for step in range(20):
        stamp_ns = BEGIN_NS + step * 10**7
        told = Command(
            kind=CommandKind.POSITION, joint_names=JOINTS, values=np.zeros(2), stamp_ns=stamp_ns
        )
        writer.write_state(stamp_ns, JOINTS, np.zeros(2))
        writer.write_command(told)
        if step < 19:
            writer.write_requested(told)
    with pytest.raises(KeyboardInterrupt), writer:
        raise KeyboardInterrupt
    assert run("salvage", tmp_path / "a.mcap.part") == 0
    assert "lost: 1 halves of commands" in capsys.readouterr().out
    saved = read_recording(tmp_path / "a_salvaged.mcap")
    assert len(saved.command_stamp_ns) == 19


@pytest.mark.parametrize("wished_at_first", [CommandKind.POSITION, CommandKind.VELOCITY])
def test_what_is_asked_for_in_another_kind_than_what_is_applied_is_no_wish_of_that_kind(
    tmp_path: Path, wished_at_first: CommandKind
) -> None:
    """An arm that bears a load nobody told of is held by positions while speeds are asked for."""
    with RecordingWriter(tmp_path / "held.mcap") as writer:
        for step in range(20):
            stamp_ns = BEGIN_NS + step * 10**7
            applied = Command(
                kind=CommandKind.POSITION, joint_names=JOINTS, values=np.ones(2), stamp_ns=stamp_ns
            )
            kind = wished_at_first if step == 0 else CommandKind.VELOCITY
            writer.write_state(stamp_ns, JOINTS, np.zeros(2))
            writer.write_command(applied)
            writer.write_requested(replace(applied, kind=kind))
    told = read_recording(tmp_path / "held.mcap")
    assert told.command_kind is CommandKind.POSITION
    if wished_at_first is CommandKind.VELOCITY:
        assert told.requested is None
    else:
        assert told.requested is not None
        assert np.isnan(told.requested[:, 0]).tolist() == [False, *[True] * 19]
