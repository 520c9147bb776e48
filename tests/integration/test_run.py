"""`gfm run`, shortened: real services, a robot in a process of its own, a report at the end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import mujoco
import pytest

GFM = (sys.executable, "-m", "gfm.cli", "run")


def run(*argv: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*GFM, *argv], capture_output=True, text=True, check=False, timeout=600)


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_an_unknown_hidden_effect_is_one_line_and_leaves_nothing(tmp_path):
    done = run("--hidden-effect", "gremlins", "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    line = done.stderr.strip()
    assert line.startswith("error: robot: unknown hidden effect 'gremlins'; available: ")
    assert "\n" not in line
    assert "coulomb_friction" in line
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_run_stops_its_services(tmp_path):
    out = tmp_path / "out"
    with subprocess.Popen(
        [*GFM, "--out", str(out)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        deadline_s = time.monotonic() + 60.0
        while not all(map(any, (out.glob("recordings/*"), out.glob("task/before/recordings/*")))):
            assert time.monotonic() < deadline_s
            assert process.poll() is None
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=120.0)[1] == "interrupted\n"
    assert process.returncode == 130
    logs = {path.name: path.read_text() for path in (out / "logs").glob("*.log")}
    assert logs.pop("task.log").endswith("interrupted\n")
    assert set(logs) == {"replay.log", "robot.log", "robot-bridge.log", "router.log"}
    logs |= {str(path): path.read_text() for path in (out / "task").rglob("*.log")}
    assert len(logs) == 7
    assert all("stopped" in text for text in logs.values())


@pytest.mark.slow
def test_a_short_run_closes_the_loop(tmp_path):
    out = tmp_path / "out"
    short = ("--motion-s", "4", "--budget-minutes", "6")
    done = run("--hidden-effect", "coulomb_friction", "--seed", "1", *short, "--out", str(out))
    assert done.returncode == 0, done.stderr
    report = json.loads((out / "report.json").read_text())
    check_findings(report)
    assert not any(is_running(process["pid"]) for process in report["system"]["processes"])
    for name in ("corrected.xml", "models/corrected_velocity.xml", "models/sawyer_position.xml"):
        mujoco.MjModel.from_xml_path(str(out / name))
    assert len(list((out / "recordings").glob("*.mcap"))) == 10
    assert (out / "checkpoints" / "gfm.npz").exists()
    assert "Revealed after the verdict" in done.stdout
    page = (out / "report.html").read_text()
    assert "<html" in page
    assert 'href="#task"' in page
    check_task(report["task"])


def check_task(task: dict) -> None:
    """The second robot's encoder is found, and the policy reaches more with the tool in place."""
    assert [(e["effect"], e["joints"]) for e in task["diagnosis"]["effects"]] == [
        ("encoder_offset", ["right_j1"])
    ]
    before, after = (told["success"] for told in (task["before"], task["after"]["placed"]))
    assert before["of"] == after["of"] == 20
    assert after["reached"] >= before["reached"] + 6


def check_findings(report: dict) -> None:
    assert report["diagnosis"]["verdict"] == "explained"
    assert report["revealed"]["name_matches"]
    assert report["revealed"]["joint_matches"]
    overall = {row["model"]: row["overall"] for row in report["comparison"]["models"]}
    kinds = {"nominal", "identified", "hybrid", "corrected", "corrected_hybrid"}
    assert set(overall) == kinds
    assert overall["corrected_hybrid"] < 1.5 * report["comparison"]["noise_floor"]
    assert overall["corrected"] < 1.5 * report["comparison"]["noise_floor"]
    assert overall["hybrid"] < overall["nominal"]
    roles = [process["role"] for process in report["system"]["processes"]]
    assert sorted(roles) == ["actor", "actor", "learner", "replay", "robot", "robot_bridge"]
    assert report["system"]["learner_steps"] > 0
    assert report["system"]["rejected_messages"] == 0


@pytest.mark.slow
def test_a_run_without_a_hidden_effect_names_none(tmp_path):
    out = tmp_path / "out"
    done = run(
        "--hidden-effect", "none", "--skip-gfm", "--skip-task", "--motion-s", "4", "--out", str(out)
    )
    assert done.returncode == 0, done.stderr
    report = json.loads((out / "report.json").read_text())
    assert report["diagnosis"]["verdict"] == "no_gap"
    assert report["diagnosis"]["effects"] == report["revealed"]["hidden"] == []
    assert report["training"] == []
