"""The notebooks of the documentation run, cell by cell, on short recordings."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest
from foreign import Sources
from transcripts import WAYS

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = ROOT / "docs" / "notebooks"
DATA = ROOT.parent / "shared" / "data"
WAY_OF = {"csv_and_urdf": "csv", "ros2_bag": "ros2", "lerobot_dataset": "lerobot"}
MINUTES = "MINUTES = 5 "


def cells(name: str) -> list[dict[str, Any]]:
    document = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text())
    assert (document["nbformat"], document["nbformat_minor"]) == (4, 5)
    return document["cells"]


def code(name: str) -> list[str]:
    return ["".join(cell["source"]) for cell in cells(name) if cell["cell_type"] == "code"]


def run(cell: str, names: dict[str, Any]) -> object:
    """Runs a cell; returns what its last line is worth, as a notebook shows it."""
    *rest, last = ast.parse(cell).body
    if not isinstance(last, ast.Expr):
        rest, last = [*rest, last], None
    exec(compile(ast.Module(body=rest, type_ignores=[]), "cell", "exec"), names)
    if last is None:
        return None
    return eval(compile(ast.Expression(body=last.value), "cell", "eval"), names)


def gone_through(name: str, folder: Path, minutes: float, **taken: Any) -> list[object]:
    """Runs a notebook in a folder with its files; returns what its cells show."""
    (way,) = [way for way in WAYS if way.name == WAY_OF[name]]
    way.make(folder, Sources(data=DATA, **taken))
    first, *rest = code(name)
    assert MINUTES in first
    names: dict[str, Any] = {}
    first = first.replace(MINUTES, f"MINUTES = {minutes} ")
    return [run(cell, names) for cell in (first, *rest)]


@pytest.fixture
def reader(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a reader who has the recordings."""
    del data
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_each_notebook_is_of_one_way() -> None:
    assert {path.stem for path in NOTEBOOKS.glob("*.ipynb")} == set(WAY_OF)
    assert set(WAY_OF.values()) <= {way.name for way in WAYS}


@pytest.mark.parametrize("name", WAY_OF)
def test_a_notebook_is_stored_without_outputs(name: str) -> None:
    stored = [cell for cell in cells(name) if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in stored)
    assert len({cell["id"] for cell in cells(name)}) == len(cells(name))


@pytest.mark.parametrize("name", WAY_OF)
def test_a_notebook_runs_on_short_recordings(name: str, reader: Path) -> None:
    shown = gone_through(name, reader, minutes=0.01, longest_s=2.5, most=2)
    with_tables = [one for one in shown if hasattr(one, "_repr_html_")]
    assert len(with_tables) >= 2  # the doctor's checks, the diagnosis
    assert all(one._repr_html_() for one in with_tables)
    assert (reader / "diagnosis" / "report.html").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("name", WAY_OF)
def test_a_notebook_runs_as_it_is(name: str, reader: Path) -> None:
    (way,) = [way for way in WAYS if way.name == WAY_OF[name]]
    gone_through(name, reader, minutes=5, most=way.recordings)
    assert (reader / "diagnosis" / "corrected.xml").is_file()
