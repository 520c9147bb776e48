"""The page of messages for bad input agrees with the code: all cases are there, some are run."""

from __future__ import annotations

import errno
import re
from pathlib import Path

import pytest
from bad_inputs import CASES, Case
from messages import command_of, files

from gfm.cli import main as gfm
from gfm.service import exit_status

PAGE = Path(__file__).parents[2] / "docs" / "messages.md"
ROW = re.compile(r"\| `(?P<command>[^`]+)` \| (?P<wrong>.+?) \| (?P<said>.+) \| (?P<status>\d) \|")
#: Quick ones of every kind; what argparse says differs between versions of Python.
RUN = {
    "gfm diagnose": (
        "a recording cut in half",
        "a held-out recording that is learned from",
        "a model of another robot",
        "one joint in degrees, the other in radians",
        "NaN among the positions",
    ),
    "gfm fit": (
        "one recording alone, nothing held out",
        "no object poses, though the model has an object",
    ),
    "gfm import": (
        "a column that is not there",
        "a clock that stands still",
        "a table whose clock is set back, without a mapping",
        "measured in degrees, told in radians",
        "a parquet file cut in half",
        "a LeRobot dataset without actions",
        "a bag without joint states",
        "two robots in one bag",
        "a bag whose clock jumps back by 5 s",
    ),
    "gfm recording": ("check: a recording that was cut off", "cut: a name that exists"),
    "gfm excite": ("an effect that does not exist", "no seconds"),
    "gfm evaluate": ("a policy for another task",),
    "gfm drive": ("a policy for another task", "a folder that is in use"),
    "gfm transfer": ("a folder that is in use",),
    "gfm train": ("an unknown environment",),
    "gfm run": ("a folder that is in use",),
    "gfm track": (
        "run: images of another size than the camera's",
        "calibrate: images of two sizes",
        "tags: one that the family lacks",
    ),
    "gfm up": ("an unknown environment",),
    "gfm-actor": ("an unknown setting",),
    "gfm-robot-bridge": ("a share of the speed above 1",),
}


def rows() -> dict[tuple[str, str], re.Match[str]]:
    found = [found for line in PAGE.read_text().splitlines() if (found := ROW.fullmatch(line))]
    return {(one["command"], one["wrong"]): one for one in found}


def chosen() -> list[Case]:
    return [one for one in CASES if one.wrong in RUN.get(one.command, ())]


def test_every_case_has_its_row_with_the_status_that_is_documented():
    told = rows()
    assert set(told) == {(one.command, one.wrong) for one in CASES}
    assert len(CASES) >= 60
    assert all(told[one.command, one.wrong]["status"] == str(one.status) for one in CASES)


def test_the_cases_that_are_run_are_there():
    assert len(chosen()) == sum(map(len, RUN.values()))


@pytest.mark.parametrize("case", chosen(), ids=lambda one: f"{one.command}: {one.wrong}")
def test_a_command_says_what_the_page_says_and_leaves_nothing(case, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main, words = command_of(case)
    words, before = [*words, *case.words()], files()
    capsys.readouterr()
    assert main(words) == case.status
    (line,) = capsys.readouterr().err.splitlines()
    assert line.replace("|", "\\|").replace("<", "&lt;") == rows()[case.command, case.wrong]["said"]
    assert files() == before


def test_a_command_line_that_makes_no_sense_is_one_line(capsys):
    with pytest.raises(SystemExit) as ended:
        gfm(["diagnose"])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: the following arguments are required: RECORDING, --model, --out")
    assert line.endswith("(`gfm diagnose --help` tells what is expected)")


def test_a_full_disk_is_one_line(capsys):
    def fill():
        raise OSError(errno.ENOSPC, "No space left on device", "out/table.csv")

    assert exit_status(fill) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "error: out/table.csv: No space left on device; expected room to write"


def test_another_error_of_the_system_is_not_hidden():
    def fail():
        raise OSError(errno.EIO, "Input/output error", "disk")

    with pytest.raises(OSError, match="Input/output"):
        exit_status(fail)
