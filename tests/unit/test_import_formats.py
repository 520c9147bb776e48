"""Parquet, NumPy and MATLAB files become recordings, number for number."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io

from gfm.core import ConfigError, RecordingError
from gfm.core.extras import needed
from gfm.importing import imported
from gfm.importing.formats.csv_text import read_csv
from gfm.importing.formats.json_rows import read_json
from gfm.importing.mapping import Mapping, load_mapping

BEGAN_NS = 1_700_000_000_123_456_789
STAMP_NS = BEGAN_NS + 5_000_000 * np.arange(20)
POSITION = np.random.default_rng(0).normal(size=(20, 2))
COMMAND = np.random.default_rng(1).normal(size=(20, 2))


def mapping(tmp_path: Path, file_format: str, prefix: str = "") -> Mapping:
    joints = "".join(
        f"""
[[joints]]
name = "{name}"
position = {{ column = "{prefix}q", index = {i} }}
command = {{ column = "{prefix}goal", index = {i} }}
"""
        for i, name in enumerate(["shoulder", "elbow"])
    )
    head = f'format = "{file_format}"\ncommand_kind = "position"\n'
    time = f'time = {{ column = "{prefix}t", scale = 1e-9 }}\n'
    (tmp_path / "map.toml").write_text(head + time + joints)
    return load_mapping(tmp_path / "map.toml")


def write_parquet(path: Path, **arrays: Any) -> None:
    columns = {name: pa.array(np.asarray(array).tolist()) for name, array in arrays.items()}
    pa.parquet.write_table(pa.table(columns), path)


def write_npz(path: Path, **arrays: Any) -> None:
    np.savez(path, **arrays)


def write_mat(path: Path, **arrays: Any) -> None:
    scipy.io.savemat(path, arrays)


def write_mat73(path: Path, **arrays: Any) -> None:
    """As MATLAB writes version 7.3: HDF5 behind a header, arrays transposed, texts as numbers."""
    with h5py.File(path, "w", userblock_size=512) as file:
        _add_variables(file, arrays)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def _add_variables(group: h5py.Group, arrays: dict[str, Any]) -> None:
    for name, value in arrays.items():
        if isinstance(value, dict):
            _add_variables(group.create_group(name), value)
            continue
        kind = "char" if isinstance(value, str) else np.asarray(value).dtype.name
        codes = [[ord(c) for c in value]] if isinstance(value, str) else value
        whole = np.atleast_2d(np.asarray(codes, np.uint16 if kind == "char" else None))
        group[name] = whole.T
        group[name].attrs["MATLAB_class"] = np.bytes_(kind.replace("float64", "double"))


WRITERS = (
    ("parquet", write_parquet),
    ("npz", write_npz),
    ("mat", write_mat),
    ("mat", write_mat73),
)
Writer = Callable[..., None]
each_format = pytest.mark.parametrize(("kind", "write"), WRITERS)


@each_format
def test_numbers_arrive_exactly(tmp_path: Path, kind: str, write: Writer) -> None:
    path = tmp_path / f"run.{kind}"
    write(path, t=STAMP_NS, q=POSITION, goal=COMMAND)
    (trajectory,) = imported([path], mapping(tmp_path, kind))
    assert trajectory.joint_names == ("shoulder", "elbow")
    np.testing.assert_array_equal(trajectory.stamp_ns, STAMP_NS)
    np.testing.assert_array_equal(trajectory.position, POSITION)
    np.testing.assert_array_equal(trajectory.command, COMMAND)


@pytest.mark.parametrize("write", [write_mat, write_mat73])
def test_time_runs_along_the_longer_side_and_structures_have_fields(
    tmp_path: Path, write: Writer
) -> None:
    log = {"t": STAMP_NS[:, None], "q": POSITION.T, "goal": COMMAND.T, "about": "an arm"}
    write(tmp_path / "run.mat", log=log)
    (trajectory,) = imported([tmp_path / "run.mat"], mapping(tmp_path, "mat", "log."))
    np.testing.assert_array_equal(trajectory.position, POSITION)
    assert trajectory.metadata["log.about"] == "an arm"


TABLE = {"t": [0.0, 0.01], "q": [1.5, -2.0], "u": [0.25, 1e-3]}


@pytest.mark.parametrize(
    "text",
    [
        "t,q,u\n0.0,1.5,0.25\n0.01,-2.0,1e-3\n",
        "\ufefft,q,u\r\n0.0,1.5,0.25\r\n0.01,-2.0,1e-3\r\n",
        "t;q;u\n0.0;1.5;0.25\n0.01;-2.0;1e-3\n",
        "t;q;u\n0,0;1,5;0,25\n0,01;-2,0;1,0e-3\n",
        "t\tq\tu\n0.0\t1.5\t0.25\n0.01\t-2.0\t1e-3\n",
        "# by hand\nt,q,u\n0.0,1.5,0.25\n0.01,-2.0,1e-3\n",
        "# by NumPy\n# t q u\n0.0  1.5  0.25\n0.01 -2.0 1e-3\n",
    ],
)
def test_a_table_may_be_separated_as_its_writer_likes(text: str) -> None:
    cells = read_csv(text.encode(), "").cells
    assert {name: [float(cell) for cell in cells[name]] for name in cells} == TABLE


@pytest.mark.parametrize(
    "text",
    [
        json.dumps({"robot": "arm", **TABLE}),
        "\n".join(
            json.dumps(dict(zip(TABLE, row, strict=True)))
            for row in zip(*TABLE.values(), strict=True)
        ),
    ],
)
def test_json_may_be_lists_or_a_row_in_every_line(text: str) -> None:
    assert read_json(text.encode(), "").cells == TABLE


def test_lists_of_a_comma_table_keep_their_commas() -> None:
    text = 't;q\n0;"[1,2]"\n1;"[3,4]"\n'
    assert read_csv(text.encode(), "").cells["q"] == ["[1,2]", "[3,4]"]


def test_time_stamps_of_parquet_are_nanoseconds(tmp_path: Path) -> None:
    stamps = pa.array(STAMP_NS // 1000, pa.timestamp("us"))
    lists = {name: pa.array(v.tolist()) for name, v in (("q", POSITION), ("goal", COMMAND))}
    row = pa.StructArray.from_arrays([stamps, *lists.values()], ["t", *lists])
    pa.parquet.write_table(pa.table({"row": row}), tmp_path / "run.parquet")
    (trajectory,) = imported([tmp_path / "run.parquet"], mapping(tmp_path, "parquet", "row."))
    np.testing.assert_array_equal(trajectory.stamp_ns, STAMP_NS // 1000 * 1000)


@each_format
def test_a_file_cut_in_half_is_refused(tmp_path: Path, kind: str, write: Writer) -> None:
    path = tmp_path / f"run.{kind}"
    write(path, t=STAMP_NS, q=POSITION, goal=COMMAND)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(RecordingError, match=f"run.{kind}: cannot be read as {kind}"):
        list(imported([path], mapping(tmp_path, kind)))


@pytest.mark.parametrize("kind", ["parquet", "npz", "mat"])
def test_another_format_is_refused(tmp_path: Path, kind: str) -> None:
    (tmp_path / "run.bin").write_text("t,q\n0,0\n")
    with pytest.raises(RecordingError, match=f"cannot be read as {kind}"):
        list(imported([tmp_path / "run.bin"], mapping(tmp_path, kind)))


@each_format
def test_bad_numbers_are_refused(tmp_path: Path, kind: str, write: Writer) -> None:
    path = tmp_path / f"run.{kind}"
    position = POSITION.copy()
    position[4, 1] = np.nan
    write(path, t=STAMP_NS, q=position, goal=COMMAND)
    with pytest.raises(RecordingError, match=r"column q: row 5: is nan; expected a finite number"):
        list(imported([path], mapping(tmp_path, kind)))
    write(path, t=STAMP_NS[::-1], q=POSITION, goal=COMMAND)
    with pytest.raises(RecordingError, match=r"column t: row 2 is .* before the row above"):
        list(imported([path], mapping(tmp_path, kind)))
    write(path, t=STAMP_NS, q=POSITION[:, :1], goal=COMMAND)
    with pytest.raises(RecordingError, match=r"column q: row 1: .* a list of at least"):
        list(imported([path], mapping(tmp_path, kind)))
    write(path, t=STAMP_NS, goal=COMMAND)
    with pytest.raises(
        RecordingError, match=r"column q: is missing; .* in the file: (t, goal|goal, t)"
    ):
        list(imported([path], mapping(tmp_path, kind)))


def test_arrays_of_another_length_are_refused(tmp_path: Path) -> None:
    write_npz(tmp_path / "run.npz", t=STAMP_NS, q=POSITION, goal=COMMAND[:15])
    with pytest.raises(RecordingError, match=r"column goal: has 15 rows; expected 20"):
        list(imported([tmp_path / "run.npz"], mapping(tmp_path, "npz")))


def test_empty_tables_are_refused(tmp_path: Path) -> None:
    write_npz(tmp_path / "run.npz", t=STAMP_NS, q=POSITION, goal=COMMAND, t_goal=STAMP_NS[:0])
    told = mapping(tmp_path, "npz")
    late = msgspec.structs.replace(told, command_time="t_goal")
    with pytest.raises(RecordingError, match="column t_goal: has no rows"):
        list(imported([tmp_path / "run.npz"], late))
    write_parquet(tmp_path / "run.parquet", t=STAMP_NS[:0], q=POSITION[:0], goal=COMMAND[:0])
    with pytest.raises(RecordingError, match="has no rows; expected a table"):
        list(imported([tmp_path / "run.parquet"], mapping(tmp_path, "parquet")))


def test_times_beyond_any_clock_are_refused(tmp_path: Path) -> None:
    write_npz(tmp_path / "run.npz", t=STAMP_NS * 1000, q=POSITION, goal=COMMAND)
    with pytest.raises(RecordingError, match=r"column t: reaches .* time.scale"):
        list(imported([tmp_path / "run.npz"], mapping(tmp_path, "npz")))


def test_a_missing_package_is_named_with_what_to_install(monkeypatch: Any) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ConfigError, match=r"pyarrow, not installed; .*'gfm-sim2real\[formats\]'"):
        needed("pyarrow", "Parquet files need", "formats")
