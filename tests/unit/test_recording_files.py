"""`gfm recording export`, and what is written under a new name: whole, and over nothing."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from gfm.recording import RecordingWriter, write_recording
from gfm.recording.new_file import give_name, new_file
from swings import JOINTS, left_by_a_crash, names, run, swing


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
