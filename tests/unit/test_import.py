"""Tables of other tools become recordings, as a mapping says; nothing is guessed."""

from __future__ import annotations

import argparse
import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gfm.core import BadInputError, CommandKind, ConfigError, RecordingError
from gfm.core.rounding import in_steps_of, resolution
from gfm.experiments import import_command
from gfm.importing import imported
from gfm.importing.mapping import Mapping, load_mapping
from gfm.importing.reading_times import at_stamps
from gfm.recording import read_recording

SIMPLE = """
format = "csv"
time = { column = "t", scale = 1e-3 }
command_kind = "effort"
[[joints]]
name = "joint"
position = { column = "ticks", scale = 0.5, offset = 1.0 }
effort = { column = "pwm", wrap = 65536, scale = -1.0 }
command = "tau"
"""


def mapping(tmp_path: Path, text: str) -> Mapping:
    (tmp_path / "map.toml").write_text(text)
    return load_mapping(tmp_path / "map.toml")


def csv_file(path: Path, rows: list[list[Any]]) -> Path:
    text = "".join(",".join(str(cell) for cell in row) + "\n" for row in rows)
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(text.encode()))
    else:
        path.write_text(text)
    return path


def rows(count: int = 12) -> list[list[Any]]:
    body = [[10 * i, i, 65536 - i if i else 0, 0.1 * i] for i in range(count)]
    return [["t", "ticks", "pwm", "tau"], *body]


@pytest.mark.parametrize("name", ["run.csv", "run.csv.gz"])
def test_units_offsets_and_wraps_are_applied(tmp_path: Path, name: str) -> None:
    path = csv_file(tmp_path / name, rows())
    (trajectory,) = imported([path], mapping(tmp_path, SIMPLE))
    assert trajectory.name == "run"
    assert trajectory.stamp_ns.tolist() == [10_000_000 * i for i in range(12)]
    assert trajectory.position[:, 0].tolist() == [1.0 + 0.5 * i for i in range(12)]
    assert trajectory.effort is not None
    assert trajectory.effort[:, 0].tolist() == list(range(12))
    np.testing.assert_allclose(trajectory.command[:, 0], 0.1 * np.arange(12))
    assert trajectory.velocity is None
    assert trajectory.command_kind is CommandKind.EFFORT
    assert trajectory.metadata["imported_from"] == name


JSON = """
format = "json"
rows = "entries"
name = "p{gain}_{stem}"
time = "t"
command_kind = "position"
[[joints]]
name = "joint"
position = "q"
command = "goal"
[servo_gain]
header = "gain"
reference = 4
[released]
column = "on"
value = "false"
"""


def entries(on: list[bool]) -> list[dict[str, Any]]:
    return [{"t": 0.01 * i, "q": i, "goal": -i, "on": flag} for i, flag in enumerate(on)]


def test_a_released_servo_makes_recordings_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "drop.json"
    on = [True] * 20 + [False] * 30 + [True] * 3 + [False] * 10
    path.write_text(json.dumps({"gain": 1, "entries": entries(on)}))
    held, first, second = imported([path], mapping(tmp_path, JSON))
    assert (held.name, len(held.stamp_ns), held.servo_gain) == ("p1_drop", 20, {"joint": 0.25})
    assert (first.name, len(first.stamp_ns)) == ("p1_drop_released", 30)
    assert (second.name, len(second.stamp_ns)) == ("p1_drop_released_2", 10)
    assert first.servo_gain == second.servo_gain == {"joint": 0.0}
    assert first.position[0, 0] == -first.command[0, 0] == 20
    assert held.metadata["gain"] == "1"


TWO_FILES = """
format = "csv"
time = "t"
command_kind = "position"
[files]
states = "*_state.csv"
commands = "*_goal.csv"
[[joints]]
name = "b"
position = { column = "q", index = 1 }
velocity = { column = "v", index = 1 }
command = { column = "q", index = 1 }
[[joints]]
name = "a"
position = { column = "q", index = 0 }
velocity = { column = "v", index = 0 }
command = { column = "q", index = 0 }
"""


def pair(folder: Path, stem: str) -> list[Path]:
    states = [["t", "q", "v"], *([i, f'"[{i}, {10 * i}]"', '"[0, 1]"'] for i in range(10))]
    goals = [["t", "q"], *([2 * i, f'"[{-i}, {-10 * i}]"'] for i in range(5))]
    return [
        csv_file(folder / f"{stem}_state.csv.gz", states),
        csv_file(folder / f"{stem}_goal.csv", goals),
    ]


def test_measurements_and_commands_may_lie_in_two_files(tmp_path: Path) -> None:
    paths = pair(tmp_path, "walk") + pair(tmp_path, "jump")
    jump, walk = imported(paths, mapping(tmp_path, TWO_FILES))
    assert (jump.name, walk.name) == ("jump", "walk")
    assert walk.joint_names == ("b", "a")
    assert walk.position[3].tolist() == [30.0, 3.0]
    assert walk.command[3].tolist() == [-30.0, -3.0]
    assert walk.command_stamp_ns[3] == 6 * 10**9


def test_a_file_without_its_partner_is_refused(tmp_path: Path) -> None:
    paths = pair(tmp_path, "walk")
    two = mapping(tmp_path, TWO_FILES)
    with pytest.raises(RecordingError, match=r"stands alone; expected walk_goal.csv as well"):
        list(imported(paths[:1], two))
    other = csv_file(tmp_path / "other.csv", rows())
    with pytest.raises(RecordingError, match=r"fits neither; expected \*_state.csv or"):
        list(imported([*paths, other], two))


def spoiled(column: int, row: int, value: Any) -> list[list[Any]]:
    table = rows()
    table[row][column] = value
    return table


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (spoiled(1, 5, "abc"), "column ticks: row 5: is 'abc'; expected a finite number"),
        (spoiled(1, 5, ""), "column ticks: row 5: is ''"),
        (spoiled(1, 5, "nan"), "column ticks: row 5: is 'nan'"),
        (spoiled(0, 5, 10), "column t: row 5 is 0.020000 s before the row above"),
        (spoiled(0, 5, 30), "strictly increasing times"),
        (spoiled(0, 1, -5), "times of at least 0 s"),
        (spoiled(1, 0, "counts"), "one of the columns in the file: t, counts, pwm, tau"),
        (rows(3), "has 3 rows; expected 10 or more"),
        (rows(0), "has no rows"),
        ([*rows(), [1, 2]], "row 13 has 2 cells for 4 columns"),
    ],
)
def test_refuses(tmp_path: Path, table: list[list[Any]], words: str) -> None:
    path = csv_file(tmp_path / "bad.csv", table)
    with pytest.raises(RecordingError, match=words) as refused:
        list(imported([path], mapping(tmp_path, SIMPLE)))
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ('format = "csv"', 'format = "xml"'),
            "expected one of csv, json, mat, npz, parquet, lerobot, rosbag",
        ),
        (("position = {", "posit = {"), "posit"),
        (('"effort"', '"torque"'), "torque"),
        (('name = "joint"', "name = 3"), "joints"),
        (('format = "csv"', "format = csv"), "line 2"),
        (('name = "joint"', 'name = "joint"\nread_offset_s = 18'), "read_offset_s of joint is 18"),
    ],
)
def test_mappings_are_checked(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        mapping(tmp_path, SIMPLE.replace(*change))


def test_two_files_never_become_one_recording(tmp_path: Path) -> None:
    paths = [csv_file(tmp_path / name, rows()) for name in ("a.csv", "a.csv.gz")]
    with pytest.raises(RecordingError, match="a name that tells them apart"):
        list(imported(paths, mapping(tmp_path, SIMPLE)))


def test_a_name_template_cannot_leave_the_folder(tmp_path: Path) -> None:
    path = csv_file(tmp_path / "a.csv", rows())
    top = 'name = "../{stem}"\n'
    with pytest.raises(BadInputError, match="plain file name"):
        list(imported([path], mapping(tmp_path, top + SIMPLE)))
    with pytest.raises(ConfigError, match="available: stem"):
        list(imported([path], mapping(tmp_path, top.replace("stem", "mass") + SIMPLE)))


def run(*words: str | Path) -> int:
    parser = argparse.ArgumentParser()
    import_command.add_parser(parser.add_subparsers())
    arguments = parser.parse_args(["import", *(str(word) for word in words)])
    return int(arguments.run(arguments))


def test_the_command_writes_all_or_nothing(tmp_path: Path, capsys: Any) -> None:
    mapping(tmp_path, SIMPLE)
    good = csv_file(tmp_path / "good.csv", rows())
    bad = csv_file(tmp_path / "bad.csv", spoiled(1, 5, "abc"))
    out = tmp_path / "out"
    with pytest.raises(RecordingError):
        run(good, bad, "--mapping", tmp_path / "map.toml", "--out", out)
    assert not out.exists()
    assert run(good, "--mapping", tmp_path / "map.toml", "--out", out) == 0
    assert "12 measurements" in capsys.readouterr().out
    assert read_recording(out / "good.mcap").joint_names == ("joint",)


def test_tables_need_a_mapping(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no --mapping given"):
        run(csv_file(tmp_path / "a.csv", rows()), "--out", tmp_path / "out")


def test_joints_read_after_their_stamp_are_put_back(tmp_path: Path) -> None:
    """A row's stamp is when its cycle began; the joint was read 18 ms later."""
    time_s = 0.02 * np.arange(100)
    read = np.sin(4.0 * (time_s + 0.018))
    body = [[1000 * t, q, 65536 - 1, 0.0] for t, q in zip(time_s, read, strict=True)]
    path = csv_file(tmp_path / "run.csv", [["t", "ticks", "pwm", "tau"], *body])
    text = SIMPLE.replace("scale = 0.5, offset = 1.0", "scale = 1.0").replace(
        'name = "joint"', 'name = "joint"\nread_offset_s = 0.018'
    )
    (trajectory,) = imported([path], mapping(tmp_path, text))
    found = trajectory.position[:, 0]
    np.testing.assert_allclose(found[2:-1], np.sin(4.0 * time_s)[2:-1], atol=2e-4)
    np.testing.assert_allclose(found, np.sin(4.0 * time_s), atol=5e-3)
    assert np.abs(read - np.sin(4.0 * time_s)).max() > 0.07
    assert trajectory.stamp_ns.tolist() == (20_000_000 * np.arange(100)).tolist()
    assert trajectory.effort is not None
    np.testing.assert_allclose(trajectory.effort, 1.0)


@pytest.mark.parametrize("offset_s", [-0.013, 0.0, 0.004, 0.02])
def test_a_straight_motion_is_put_back_exactly_at_uneven_stamps(offset_s: float) -> None:
    steps_ns = np.random.default_rng(0).integers(8_000_000, 12_000_000, 50)
    stamp_ns = np.cumsum(steps_ns)
    line = 3.0 + 2.0 * (stamp_ns * 1e-9 + offset_s)
    np.testing.assert_allclose(at_stamps(stamp_ns, line, offset_s), 3.0 + 2e-9 * stamp_ns)


def test_what_an_encoder_rounded_stays_rounded_when_it_is_put_back_in_time() -> None:
    stamp_ns = 20_000_000 * np.arange(400)
    smooth = 0.3 * np.sin(3.0 * (1e-9 * stamp_ns + 0.012))
    read = 1.5e-3 * np.round(smooth / 1.5e-3)
    put_back = in_steps_of(at_stamps(stamp_ns, read, 0.012), read)
    assert resolution(put_back[:, None]) == pytest.approx(1.5e-3)
    true = 0.3 * np.sin(3e-9 * stamp_ns)
    assert np.abs(put_back - true).max() < 3e-3
    assert np.sqrt(np.mean((put_back - true) ** 2)) < 1e-3
    np.testing.assert_array_equal(in_steps_of(smooth, smooth), smooth)


@pytest.mark.parametrize("scale", ["1e-9", "10.0"])
def test_times_in_another_unit_are_refused(tmp_path: Path, scale: str) -> None:
    path = csv_file(tmp_path / "run.csv", rows())
    with pytest.raises(RecordingError, match=r"column t: rows are .* s apart; .*time.scale"):
        list(imported([path], mapping(tmp_path, SIMPLE.replace("1e-3", scale))))


OBJECT = (
    SIMPLE
    + """
[object]
x = "x"
y = { column = "y", scale = 1e-3 }
z = "z"
qw = "w"
qx = "i"
qy = "j"
qz = "k"
"""
)


def object_rows(length: float = 1.0) -> list[list[Any]]:
    head, *body = rows()
    poses = [[0.1 * i, 20.0, 0.5, 0.6 * length, 0.0, 0.0, 0.8 * length] for i in range(len(body))]
    return [
        [*head, "x", "y", "z", "w", "i", "j", "k"],
        *(a + b for a, b in zip(body, poses, strict=True)),
    ]


def test_poses_of_an_object_come_along(tmp_path: Path) -> None:
    path = csv_file(tmp_path / "run.csv", object_rows())
    (trajectory,) = imported([path], mapping(tmp_path, OBJECT))
    track = trajectory.object_track
    assert track is not None
    assert track.stamp_ns.tolist() == trajectory.stamp_ns.tolist()
    np.testing.assert_allclose(track.position[3], [0.3, 0.02, 0.5])
    np.testing.assert_allclose(track.quaternion[3], [0.6, 0.0, 0.0, 0.8])


def test_quaternions_of_another_length_are_refused(tmp_path: Path) -> None:
    path = csv_file(tmp_path / "run.csv", object_rows(length=2.0))
    with pytest.raises(RecordingError, match="row 1 has length 2; expected a quaternion of length"):
        list(imported([path], mapping(tmp_path, OBJECT)))
