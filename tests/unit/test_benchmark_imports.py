"""Benchmarks take from gfm what is there: some need packages that no test has, and would rot."""

import ast
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def taken(text):
    """The names that a program takes from rooms of gfm."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "gfm":
            yield from ((node.module, one.name) for one in node.names)


def missing(text):
    return [
        (room, name)
        for room, name in taken(text)
        if not hasattr(import_module(room), name) and find_spec(f"{room}.{name}") is None
    ]


@pytest.mark.parametrize("path", sorted(BENCHMARKS.rglob("*.py")), ids=lambda path: path.stem)
def test_what_a_benchmark_takes_from_gfm_is_there(path):
    assert missing(path.read_text(encoding="utf-8")) == []


def test_what_moved_away_is_missed():
    text = "from gfm.core import Trajectory, Nothing\nfrom gfm.signals import smoothing\n"
    assert missing(text) == [("gfm.core", "Nothing")]
