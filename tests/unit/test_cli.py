"""The command `gfm` as its users meet it."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import gfm
from gfm.cli import SUBCOMMANDS, main, make_parser
from gfm.core import BadInputError, ConfigError
from gfm.experiments.run_settings import RunSettings
from gfm.parser import OneLineParser

MODELS = Path(__file__).parents[2] / "models"
NAMES = [one.name for one in SUBCOMMANDS]


def exit_of(*argv: str) -> int:
    """Returns the exit status, also where the parser ends the program."""
    try:
        return main(argv)
    except SystemExit as ended:
        return int(ended.code or 0)


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    return lines[0]


def test_help_has_one_line_for_every_command(capsys):
    assert exit_of("--help") == 0
    printed = capsys.readouterr().out.splitlines()
    for one in SUBCOMMANDS:
        assert any(line.split() == [one.name, *one.summary.split()] for line in printed), one.name


@pytest.mark.parametrize("one", SUBCOMMANDS, ids=NAMES)
def test_every_command_says_in_its_own_help_what_it_says_in_the_list(one, capsys):
    assert exit_of(one.name, "--help") == 0
    assert f"usage: gfm {one.name}" in capsys.readouterr().out
    adder = getattr(import_module(one.module), one.adder)
    chosen = make_parser(one.name)._subparsers._group_actions[0]
    assert callable(adder)
    assert {a.dest: a.help for a in chosen._choices_actions}[one.name] == one.summary


def test_the_version_is_the_package_s(capsys):
    assert exit_of("--version") == 0
    assert capsys.readouterr().out == f"gfm {gfm.__version__}\n"


@pytest.mark.parametrize("name", ["status", "run", "diagnose", "import", "router"])
def test_nothing_heavy_is_loaded_before_it_is_needed(name):
    code = (
        f"import sys; from gfm.cli import make_parser; make_parser({name!r}); "
        "print(*({'torch', 'mujoco', 'scipy', 'plotly', 'gymnasium', 'zenoh'} & set(sys.modules)))"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert loaded.stdout.strip() == ""


@pytest.mark.parametrize("argv", [(), ("nonsense",), ("diagnose",), ("run", "--actors", "two")])
def test_a_command_line_that_makes_no_sense_ends_with_2(argv, capsys):
    assert exit_of(*argv) == 2
    assert "gfm" in capsys.readouterr().err


@pytest.mark.parametrize("number", ["-4.9e-07", "-1E3", "-.5", "-2."])
def test_negative_numbers_are_no_options(number):
    parser = OneLineParser()
    parser.add_argument("--payload", type=float, nargs=2)
    assert parser.parse_args(["--payload", number, "1"]).payload == [float(number), 1.0]


def test_a_recording_that_is_not_there_is_one_line_and_leaves_nothing(tmp_path, capsys):
    out = tmp_path / "out"
    model = str(MODELS / "sawyer_position.xml")
    absent = str(tmp_path / "absent.mcap")
    assert main(["diagnose", absent, "--model", model, "--out", str(out)]) == 2
    assert one_line(capsys).startswith(f"error: {absent}: no such file")
    assert list(tmp_path.iterdir()) == []


def test_a_run_never_writes_into_a_folder_that_is_in_use(tmp_path, capsys):
    (tmp_path / "thesis.tex").touch()
    assert main(["run", "--out", str(tmp_path)]) == 2
    expected = f"error: {tmp_path}: exists; expected a new or an empty folder"
    assert one_line(capsys) == expected
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"actors": 0}, "actors is 0, expected 1 to 64"),
        ({"seed": -1}, "seed is -1, expected 0 to"),
        ({"budget_s": 6.0}, "budget_s is 6, expected 30 to 86400"),
        ({"motion_s": 1.0}, "motion_s is 1, expected 4 to 120"),
    ],
)
def test_run_settings_out_of_range_are_refused(tmp_path, setting, message):
    with pytest.raises(ConfigError, match=message):
        RunSettings(folder=tmp_path / "new", **setting)


def test_a_run_s_folder_must_not_be_a_file(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BadInputError, match="is a file; expected a folder to write to"):
        RunSettings(folder=tmp_path / "file")
