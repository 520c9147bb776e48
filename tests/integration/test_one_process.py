"""A robot and its bridge in the driver's own process: the same attempts, kept in the same files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from one_process import main

HIDDEN = """
[[hidden]]
effect = "encoder_offset"
joints = ["right_j1"]
parameters = { offset = 0.05 }
"""


def test_a_policy_is_driven_and_what_the_robot_hides_is_sealed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "robot.toml").write_text(HIDDEN)
    out = tmp_path / "out"
    words = ["drive", "--task", "position", "--goals", "1", "--trials", "1"]
    words += ["--robot-config", str(tmp_path / "robot.toml"), "--out", str(out)]
    monkeypatch.setattr("sys.argv", ["one_process.py", *words])
    assert main() == 0
    (attempt,) = json.loads((out / "result.json").read_text())["attempts"]
    assert Path(attempt["recording"]).is_file()
    (hidden,) = json.loads((out / "sealed.json").read_text())["effects"]
    assert hidden["effect"] == "encoder_offset"
    assert not (out / "logs").exists()


@pytest.mark.parametrize("flags", [["--real-time"], ["--connect", "tcp/127.0.0.1:1"]])
def test_time_that_passes_by_itself_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    flags: list[str],
) -> None:
    words = ["drive", "--task", "position", "--out", str(tmp_path / "out"), *flags]
    monkeypatch.setattr("sys.argv", ["one_process.py", *words])
    assert main() == 2
    assert "in one process" in capsys.readouterr().err
