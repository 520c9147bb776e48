"""The table of campaigns: what is asked for is told apart, and what came of it is told whole."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from campaigns import ROBOTS, Campaign, campaigns, failed, log_of, page, summary
from parts import done_parts

from gfm.cli import main
from gfm.experiments.policy_flags import TREATMENTS

ASKED = Campaign(robot="payload_1.0", treatments=("told",), minutes=4.0)
LOAD = {"mass": 1.0, "com_z": 0.1}


def success(reached: int, low: float, high: float) -> dict[str, object]:
    told = {"reached": reached, "of": 50, "ci95": [low, high]}
    return {"success": told, "attempts": [{"time_s": 6.0}] * 50}


def campaign_in(folder: Path) -> None:
    named = {
        "effect": "payload",
        "joints": [],
        "parameters": {name: {"value": x} for name, x in LOAD.items()},
        "confidence": 0.871,
    }
    report = {
        "air_s": 72.0,
        "before": success(1, 0.004, 0.105),
        "after": {"told": success(49, 0.895, 0.996)},
        "diagnosis": {"effects": [named]},
    }
    hidden = {
        "effect": "payload",
        "joints": [],
        "parameters": {name: {"value": x, "unit": "1"} for name, x in LOAD.items()},
    }
    (folder / "before").mkdir(parents=True)
    (folder / "report.json").write_text(json.dumps(report))
    sealed = {"schema": "gfm.sealed/1", "effects": [hidden]}
    (folder / "before" / "sealed.json").write_text(json.dumps(sealed))


def test_a_row_says_what_is_hidden_what_was_named_and_what_was_reached(tmp_path: Path) -> None:
    campaign_in(tmp_path)
    row = page({"one": {"commit": "abc", **summary(ASKED, tmp_path)}}, 24).splitlines()[-1]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[:3] == ["position", "sim", "0"]
    assert cells[3:5] == ["payload mass 1, com_z 0.1", "payload mass 1, com_z 0.1, 0.87"]
    told = dict(zip(("as it came", *TREATMENTS), cells[5:-1], strict=True))
    assert told["as it came"] == "1 of 50 (0% to 10%)"
    assert told["told"] == "49 of 50 (90% to 100%)"
    assert told["placed"] == ""
    assert cells[-1] == "6.2"


@pytest.mark.parametrize(
    "changed",
    [{"minutes": 5.0}, {"seed": 1}, {"engine": "drake"}, {"task": "pose"}, {"treatments": ()}],
)
def test_other_settings_have_another_folder(changed: dict) -> None:
    assert replace(ASKED, **changed).name != ASKED.name


def test_a_robot_that_hides_something_else_has_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = ASKED.name
    there = (ROBOTS / "payload_1.0.toml").read_text()
    (tmp_path / "payload_1.0.toml").write_text(there.replace("1.0", "1.1"))
    monkeypatch.setattr("campaigns.ROBOTS", tmp_path)
    assert ASKED.name.rpartition("-")[0] == before.rpartition("-")[0]
    assert ASKED.name != before


def test_every_campaign_is_one_that_the_command_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = campaigns(3)
    assert len({one.name for one in asked}) == len(asked)
    (tmp_path / "thesis.tex").touch()
    for one in asked:  # refused for the folder alone, after all flags were read
        assert main(["transfer", *one.words, "--out", str(tmp_path)]) == 2
        assert "expected a new or an empty folder" in capsys.readouterr().err


def test_a_campaign_that_fails_does_not_keep_the_others_from_being_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made(campaign: Campaign, folder: Path) -> dict[str, object]:
        if campaign.seed == 1:
            raise subprocess.CalledProcessError(1, str(folder))
        return {"seed": campaign.seed}

    monkeypatch.setattr("campaigns.made", made)
    asked = {one.name: one for one in (replace(ASKED, seed=seed) for seed in range(3))}
    assert failed(asked, tmp_path) == [replace(ASKED, seed=1).name]
    done = done_parts(tmp_path, [*asked], None)
    assert [part["seed"] for part in done.values()] == [0, 2]


def test_every_campaign_has_a_log_of_its_own(tmp_path: Path) -> None:
    logs = {log_of(tmp_path / replace(ASKED, seed=seed).name) for seed in range(3)}
    assert len(logs) == 3
