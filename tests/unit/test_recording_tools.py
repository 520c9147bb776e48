"""`gfm recording`: what it says, what it writes, and what it never writes over."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gfm.cli import main
from gfm.core import Command, CommandKind, ObjectTrack, Trajectory
from gfm.recording import RecordingWriter, read_recording, write_recording
from gfm.recording.new_file import give_name, new_file
from gfm.recording.overview import overview
from gfm.recording.raw import read_raw

JOINTS = ("shoulder", "elbow")
STEPS = 400
BEGIN_NS = 1_700_000_000_000_000_000


def swing(name: str = "swing") -> Trajectory:
    """Two joints at 100 Hz, commanded at 20 Hz, measured with noise, with an object's poses."""
    rng = np.random.default_rng(3)
    stamp_ns = BEGIN_NS + 10_000_000 * np.arange(STEPS, dtype=np.int64)
    time_s = 0.01 * np.arange(STEPS)
    phase = np.stack([time_s, 1.0 + 1.3 * time_s], axis=1)
    command = np.sin(phase)[::5]
    return Trajectory(
        name=name,
        joint_names=JOINTS,
        stamp_ns=stamp_ns,
        position=np.sin(phase - 0.05) + 1e-4 * rng.normal(size=(STEPS, 2)),
        velocity=np.cos(phase - 0.05) * [1.0, 1.3] + 1e-3 * rng.normal(size=(STEPS, 2)),
        effort=rng.normal(size=(STEPS, 2)),
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns[::5],
        command=command,
        requested=command + 0.1,
        object_track=ObjectTrack(
            stamp_ns=stamp_ns[::10],
            position=rng.normal(size=(STEPS // 10, 3)),
            quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (STEPS // 10, 1)),
        ),
        metadata={"run": "r1", "software": "test"},
    )


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    write_recording(tmp_path / "swing.mcap", swing())
    return tmp_path / "swing.mcap"


def run(*words: str | Path) -> int:
    return main(["recording", *(str(word) for word in words)])


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def left_by_a_crash(path: Path, steps: int = STEPS) -> Path:
    """Leaves what a killed writer leaves: no close, no footer."""
    writer = RecordingWriter(path, about={"run": "r1"})
    for step in range(steps):
        stamp_ns = BEGIN_NS + step * 10_000_000
        told = Command(
            kind=CommandKind.VELOCITY,
            joint_names=JOINTS,
            values=np.array([0.0, np.sin(step)]),
            stamp_ns=stamp_ns,
        )
        writer.write_state(stamp_ns, JOINTS, np.full(2, 0.1 * step), np.zeros(2), np.zeros(2))
        writer.write_command(told)
        writer.write_requested(replace(told, values=np.array([0.0, np.nan])))
    writer.abandon()
    return path.with_name(path.name + ".part")


# Info


def test_info_tells_rates_joints_and_metadata(recorded: Path) -> None:
    seen = overview(recorded)
    states = next(one for one in seen.topics if one.topic == "/joint_states")
    assert states.rhythm is not None
    assert (states.messages, states.joints, states.stamped_by) == (STEPS, JOINTS, "header")
    assert states.filled == ("position", "velocity", "effort")
    assert states.rhythm.rate_hz == pytest.approx(100.0)
    assert states.rhythm.jitter_s == pytest.approx(0.0, abs=1e-12)
    assert seen.duration_s == pytest.approx(3.99)
    assert (seen.begin_ns, seen.command_kind, seen.damage) == (BEGIN_NS, "position", "")
    assert seen.metadata["gfm"] == {"run": "r1", "software": "test"}


def test_info_measures_jitter_without_gaps(tmp_path: Path) -> None:
    late = np.zeros(STEPS, np.int64)
    late[1::2] = 2_000_000  # periods of 12 and 8 ms
    late[200:] += 1_000_000_000
    one = swing()
    write_recording(tmp_path / "a.mcap", replace(one, stamp_ns=one.stamp_ns + late))
    states = next(t for t in overview(tmp_path / "a.mcap").topics if t.topic == "/joint_states")
    assert states.rhythm is not None
    assert states.rhythm.jitter_s == pytest.approx(2e-3, rel=1e-4)
    assert states.rhythm.longest_gap_s == pytest.approx(1.008)


def test_info_as_json_is_one_object_a_line(recorded: Path, capsys) -> None:
    left_by_a_crash(recorded.with_name("crash.mcap"))
    assert run("info", "--json", recorded, recorded.with_name("crash.mcap.part")) == 0
    whole, part = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert whole["complete"]
    assert not part["complete"]
    assert {topic["topic"] for topic in whole["topics"]} == {
        "/joint_states",
        "/joint_command",
        "/joint_command_requested",
        "/object_pose",
    }


def test_info_in_words_names_every_topic(recorded: Path, capsys) -> None:
    assert run("info", recorded) == 0
    told = capsys.readouterr().out
    assert "3.990 s, from 1700000000.000000 s of its clock, position commands" in told
    assert "/joint_states: position, velocity, effort of shoulder, elbow" in told
    assert "gfm: software = test" in told


# Check


def echo(one: Trajectory) -> Trajectory:
    return replace(one, command_stamp_ns=one.stamp_ns, command=one.position, requested=one.position)


def long_gap(one: Trajectory) -> Trajectory:
    later = np.where(np.arange(STEPS) < 200, 0, 11_000_000_000)
    return replace(one, stamp_ns=one.stamp_ns + later)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (echo, "command equals measurement"),
        (long_gap, "comes 11.010 s after the one before"),
    ],
)
def test_check_ends_with_2_and_one_line(
    tmp_path: Path, capsys, spoil: Callable[[Trajectory], Trajectory], words: str
) -> None:
    write_recording(tmp_path / "bad.mcap", spoil(swing()))
    assert run("check", tmp_path / "bad.mcap") == 2
    said = capsys.readouterr()
    assert said.out.startswith(f"{tmp_path}/bad.mcap: unfit\n")
    (line,) = said.err.splitlines()
    assert words in line


def test_check_counts_stamps_that_are_out_of_order(tmp_path: Path, capsys) -> None:
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        for step in (*range(10), 12, 11, *range(13, 20), 19):
            writer.write_state(BEGIN_NS + step * 10**7, JOINTS, np.zeros(2))
    assert run("check", tmp_path / "a.mcap") == 2
    expected = "topic /joint_states: 2 messages are not stamped later than the one before"
    assert expected in capsys.readouterr().err


def test_check_finds_gaps_and_clock_jumps_doubtful(tmp_path: Path, capsys) -> None:
    one = swing()
    jump = np.where(np.arange(STEPS) < 200, 0, 1_000_000_000)
    write_recording(tmp_path / "jump.mcap", replace(one, stamp_ns=one.stamp_ns + jump))
    kept = np.r_[0:200, 260:STEPS]
    measured = {name: getattr(one, name)[kept] for name in ("position", "velocity", "effort")}
    write_recording(tmp_path / "lost.mcap", replace(one, stamp_ns=one.stamp_ns[kept], **measured))
    assert run("check", tmp_path) == 0
    told = capsys.readouterr().out
    assert f"{tmp_path}/jump.mcap: doubtful\n  doubtful: clock jumps by 1.01 s" in told
    assert f"{tmp_path}/lost.mcap: doubtful\n  doubtful: longest gap 0.61 s" in told


def test_check_of_a_folder_counts_what_a_crash_left(recorded: Path, capsys) -> None:
    left_by_a_crash(recorded.with_name("crash.mcap"))
    assert run("check", recorded.parent) == 2
    said = capsys.readouterr()
    assert f"{recorded}: fit\n" in said.out
    assert "`gfm recording salvage` saves what is readable" in said.out
    assert said.err == (f"error: 1 of 2 recordings are unfit: {recorded.parent}/crash.mcap.part\n")


def test_check_names_a_topic_that_is_missing(tmp_path: Path, capsys) -> None:
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        for step in range(20):
            writer.write_state(step, JOINTS, np.zeros(2))
    assert run("check", tmp_path / "a.mcap") == 2
    assert "topic /joint_command: is missing" in capsys.readouterr().err


def test_an_empty_folder_is_no_folder_of_recordings(tmp_path: Path, capsys) -> None:
    assert run("check", tmp_path) == 2
    assert "has no recording; expected *.mcap or *.mcap.part" in capsys.readouterr().err


# Cut


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


# Export


def test_csv_names_units_and_keeps_every_digit(recorded: Path, tmp_path: Path) -> None:
    assert run("export", recorded, "--out", tmp_path / "out") == 0
    assert names(tmp_path / "out") == [
        "swing_command.csv",
        "swing_measured.csv",
        "swing_object.csv",
    ]
    with (tmp_path / "out" / "swing_measured.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == [
        "time [s]",
        "stamp [ns]",
        "position.shoulder [rad]",
        "position.elbow [rad]",
        "velocity.shoulder [rad/s]",
        "velocity.elbow [rad/s]",
        "effort.shoulder [N m]",
        "effort.elbow [N m]",
    ]
    one = swing()
    assert one.velocity is not None
    assert [int(row[1]) for row in rows] == one.stamp_ns.tolist()
    assert [float(row[5]) for row in rows] == one.velocity[:, 1].tolist()


def test_parquet_holds_the_same_as_csv(recorded: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    assert run("export", recorded, "--format", "parquet", "--out", tmp_path) == 0
    table = parquet.read_table(tmp_path / "swing_command.parquet")
    assert table.schema.metadata[b"run"] == b"r1"
    np.testing.assert_array_equal(table["command.position.elbow [rad]"], swing().command[:, 1])
    asked = table["requested.position.elbow [rad]"]
    np.testing.assert_array_equal(asked, swing().command[:, 1] + 0.1)


def test_npz_names_units_in_its_arrays(recorded: Path, tmp_path: Path) -> None:
    assert run("export", recorded, "--format", "npz", "--out", tmp_path) == 0
    with np.load(tmp_path / "swing.npz") as arrays:
        np.testing.assert_array_equal(arrays["position_rad"], swing().position)
        np.testing.assert_array_equal(arrays["command_rad"], swing().command)
        assert arrays["joint_names"].tolist() == list(JOINTS)
        assert json.loads(str(arrays["metadata_json"]))["run"] == "r1"


def test_an_export_leaves_nothing_where_one_name_is_taken(recorded: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "swing_object.csv").write_text("mine")
    assert run("export", recorded, "--out", out) == 2
    assert names(out) == ["swing_object.csv"]
    assert (out / "swing_object.csv").read_text() == "mine"


# Plot


def test_a_plot_is_one_page_with_all_signals(recorded: Path) -> None:
    assert run("plot", recorded) == 0
    page = recorded.with_suffix(".html").read_text()
    for words in ("position (rad)", "effort (N m)", "place (m)", "shoulder", "asked for"):
        assert words in page


# Files


@pytest.mark.parametrize(
    "words",
    [
        ("cut", "--to", "1", "--out", "taken"),
        ("plot", "--out", "taken"),
    ],
)
def test_nothing_is_overwritten(recorded: Path, capsys, words: tuple[str, ...]) -> None:
    taken = recorded.with_name("taken")
    taken.write_text("mine")
    tool, *flags = words
    assert run(tool, recorded, *flags[:-1], taken) == 2
    assert "nothing is overwritten" in capsys.readouterr().err
    assert taken.read_text() == "mine"
    assert names(recorded.parent) == ["swing.mcap", "taken"]


def interrupted(path: Path) -> None:
    with new_file(path) as place:
        place.write_text("half")
        raise KeyboardInterrupt


def test_an_interrupted_file_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        interrupted(tmp_path / "a")
    assert names(tmp_path) == []


def test_who_takes_the_name_meanwhile_keeps_it(tmp_path: Path) -> None:
    def both() -> None:
        with new_file(tmp_path / "a") as place:
            place.write_text("late")
            (tmp_path / "a").write_text("early")

    with pytest.raises(Exception, match="nothing is overwritten"):
        both()
    assert (tmp_path / "a").read_text() == "early"
    assert names(tmp_path) == ["a"]


def test_without_links_a_file_still_gets_its_name_and_takes_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_links(_path: Path, _target: Path) -> None:
        raise PermissionError

    monkeypatch.setattr(Path, "hardlink_to", no_links)
    with new_file(tmp_path / "a") as place:
        place.write_text("first")
    part = tmp_path / "part"
    part.write_text("second")
    with pytest.raises(FileExistsError):
        give_name(part, tmp_path / "a")
    assert (tmp_path / "a").read_text() == "first"
    assert names(tmp_path) == ["a", "part"]


def test_a_writer_takes_no_name_that_was_taken_meanwhile(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap")
    (tmp_path / "a.mcap").write_text("mine")
    with pytest.raises(FileExistsError):
        writer.close()
    assert (tmp_path / "a.mcap").read_text() == "mine"
    assert names(tmp_path) == ["a.mcap", "a.mcap.part"]


def test_a_writer_keeps_aside_what_a_crash_left(tmp_path: Path) -> None:
    before = left_by_a_crash(tmp_path / "a.mcap").read_bytes()
    write_recording(tmp_path / "a.mcap", swing())
    assert (tmp_path / "a_crashed_1.mcap.part").read_bytes() == before
    assert names(tmp_path) == ["a.mcap", "a_crashed_1.mcap.part"]


def test_a_folder_that_is_none_is_one_line(recorded: Path, capsys) -> None:
    assert run("cut", recorded, "--to", "1", "--out", recorded / "part.mcap") == 2
    assert "part.mcap: File exists; expected a file to write" in capsys.readouterr().err
