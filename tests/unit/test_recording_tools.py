"""`gfm recording info`, `check`, `plot`: what is in recordings, and whether they can be used."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gfm.core import Trajectory
from gfm.recording import RecordingWriter, write_recording
from gfm.recording.overview import overview
from gfm.report.recording import recording_picture
from swings import BEGIN_NS, JOINTS, STEPS, left_by_a_crash, run, swing


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


# Plot


def test_a_plot_is_one_page(recorded: Path) -> None:
    assert run("plot", recorded) == 0
    page = recorded.with_suffix(".html").read_text()
    assert "4.0 s, 400 measurements, 80 position commands, 2 joints." in page
    assert "<td>software</td><td>test</td>" in page


def test_a_plot_has_a_panel_for_each_quantity_and_a_line_for_each_signal() -> None:
    figure = recording_picture(swing()).figure
    titles = [axis.title.text for axis in figure.select_yaxes()]
    assert titles[:3] == ["position (rad)", "velocity (rad/s)", "effort (N m)"]
    assert len(titles) == 5
    lines = [(one.name, one.line.dash) for one in figure.data if one.yaxis == "y"]
    dashes = ("solid", "dash", "dot")  # measured, told, asked for
    assert lines == [(joint, dash) for dash in dashes for joint in JOINTS]


def test_info_and_cut_take_what_others_recorded(tmp_path: Path, capsys) -> None:
    pytest.importorskip("rosbags")
    import made_bags

    folder = made_bags.write(tmp_path, "mcap", lambda m: made_bags.states(m) + made_bags.arrays(m))
    (bag,) = folder.glob("*.mcap")
    topics = ("--joint-states", "/arm/joint_states")
    seen = {one.topic: one for one in overview(bag, joint_states=topics[1]).topics}
    assert set(seen["/arm/joint_states"].joints) == set(made_bags.JOINTS)
    stamped = [seen[topic].stamped_by for topic in ("/arm/joint_states", "/arm/commands")]
    assert stamped == ["header", "log"]
    part = tmp_path / "part.mcap"
    assert run("cut", bag, *topics, "--from", "0.095", "--to", "0.2", "--out", part) == 0
    told = capsys.readouterr().out
    assert "10 on /arm/joint_states" in told
    assert "11 on /arm/commands" in told  # logged 3 ms earlier, and so by 3 ms before 0.2 s
