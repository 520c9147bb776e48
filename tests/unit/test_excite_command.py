"""The command that proposes motions: what it writes, and what it refuses in one line."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from gfm.cli import main
from gfm.core import BadInputError, CommandKind, ConfigError
from gfm.excitation.limits import Wishes
from gfm.excitation.programme import FAMILIES
from gfm.experiments.excite import joint_ranges, joint_values
from gfm.experiments.excite_command import ExciteRequest, excite, print_families

MODELS = Path(__file__).parents[2] / "models"
PENDULUM = MODELS / "xl330_pendulum.xml"
DOUBLE = MODELS / "double_pendulum_c1.xml"


def excited(out: Path, model: Path = PENDULUM, **asked) -> tuple[dict[str, object], str]:
    """Returns the plan that was written, and what was printed."""
    answer = Console(file=io.StringIO(), width=400)
    request = ExciteRequest(models=(model,), out=out, seconds=8.0, **({"wishes": Wishes()} | asked))
    excite(request, answer, Console(file=io.StringIO()))
    return json.loads((out / "plan.json").read_text()), answer.file.getvalue()


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("plan")
    plan, printed = excited(out)
    return out, plan, printed


def table(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(newline="") as file:
        header, *rows = list(csv.reader(file))
    return header, np.array(rows, float)


def test_the_plan_names_every_motion_what_it_shows_and_its_table(written):
    out, plan, _ = written
    assert plan["schema"] == "gfm.excitation/1"
    assert [one["motion"] for one in plan["motions"]] == [one.label for one in FAMILIES]
    for one, family in zip(plan["motions"], FAMILIES, strict=True):
        assert one["shows"] == list(family.shows)
        assert one["command"] == "position"
        assert one["recording"] is None
        assert (out / one["commands"]).is_file()
        assert [row["joint"] for row in one["joints"]] == ["joint"]


def test_tables_can_be_read_back_and_hold_one_motion_each(written):
    out, plan, _ = written
    for one in plan["motions"]:
        header, values = table(out / one["commands"])
        assert header == ["time_s", "joint.position", "joint.velocity", "joint.effort"]
        time_s, position, velocity, effort = values.T
        np.testing.assert_allclose(np.diff(time_s), one["period_s"], atol=1e-6)
        assert time_s[-1] == pytest.approx(one["duration_s"] - one["period_s"])
        reached = position[0] + one["period_s"] * np.cumsum(velocity)
        np.testing.assert_allclose(reached[:-1], position[1:], atol=1e-6)
        row = one["joints"][0]
        assert position.max() == pytest.approx(row["highest"], abs=1e-6)
        assert np.abs(effort).max() == pytest.approx(row["torque"], rel=1e-6)
        assert abs(effort).max() <= plan["joints"]["joint"]["effort"]


def test_the_page_is_whole_shows_every_motion_and_loads_nothing(written):
    out, plan, _ = written
    page = (out / "plan.html").read_text()
    assert page.count('<div class="plot"') == len(plan["motions"])
    for one in plan["motions"]:
        assert one["name"] in page
    assert not re.search(r"(src|href)=[\"']https?:", page.split("<script>")[0])
    assert "9 motions for xl330_pendulum, 2 minutes in all" in page
    assert len(page) < 6_000_000


def test_what_the_model_does_not_say_is_printed(written):
    _, plan, printed = written
    assert any(note.startswith("no range in the model: joint") for note in plan["notes"])
    for note in plan["notes"]:
        assert f"note: {note}" in printed
    assert "next:" not in printed


def test_what_no_motion_would_show_is_printed_and_written(written):
    out, plan, printed = written
    assert [spot["effect"] for spot in plan["blind_spots"]] == ["torque_saturation"]
    assert "not shown, even so: torque_saturation (joint): joint: took" in printed
    assert "What even these motions would not show" in (out / "plan.html").read_text()


def test_the_same_seed_makes_the_same_plan(written, tmp_path):
    out, plan, _ = written
    excited(tmp_path / "again")
    for one in plan["motions"]:
        again = tmp_path / "again" / one["commands"]
        assert again.read_bytes() == (out / one["commands"]).read_bytes()


def test_motors_get_torques_with_gains_to_keep_on_them(tmp_path):
    plan, _ = excited(tmp_path, DOUBLE, effects=("coulomb_friction",))
    assert {one["command"] for one in plan["motions"]} == {"effort"}
    assert all(len(one["stiffness"]) == len(one["damping"]) == 2 for one in plan["motions"])


def diagnosis(tmp_path: Path, **changed) -> Path:
    document = {
        "schema": "gfm.diagnosis/1",
        "verdict": "partly_explained",
        "effects": [],
        "suspects": [],
    } | changed
    path = tmp_path / "report.json"
    path.write_text(json.dumps(document))
    return path


def labels(plan) -> set[str]:
    return {one["motion"] for one in plan["motions"]} - {"waypoints", "four_sines"}


def effect(name: str, *, confidence=0.99, ci95=(0.1, 0.2)):
    parameters = {"x": {"value": 0.1, "unit": "1", "ci95": ci95}}
    return {"effect": name, "joints": ["joint"], "confidence": confidence, "parameters": parameters}


def suspect(name: str, decided_by: str = "a motion", gain: float = 0.5):
    return {"effect": name, "joints": ["joint"], "decided_by": decided_by, "gain": gain}


def test_a_diagnosis_asks_for_what_it_could_not_decide(tmp_path):
    path = diagnosis(
        tmp_path,
        effects=[effect("cogging_torque", ci95=None), effect("payload")],
        suspects=[suspect("command_delay"), suspect("coulomb_friction", "")],
    )
    plan, _ = excited(tmp_path / "out", report=path)
    assert plan["effects"] == ["command_delay", "cogging_torque"]
    assert labels(plan) == {"sweep", "multisine", "steps"}


def test_where_all_is_explained_only_close_calls_are_open(tmp_path):
    suspects = [suspect("command_delay"), suspect("cogging_torque", gain=0.97)]
    path = diagnosis(tmp_path, verdict="explained", suspects=suspects)
    assert excited(tmp_path / "out", report=path)[0]["effects"] == ["cogging_torque"]


def test_a_run_s_report_holds_a_diagnosis(tmp_path):
    path = diagnosis(tmp_path, suspects=[suspect("joint_spring")])
    inner = json.loads(path.read_text())
    path.write_text(json.dumps({"schema": "gfm.run/1", "diagnosis": inner}))
    plan, _ = excited(tmp_path / "out", report=path)
    assert plan["effects"] == ["joint_spring"]


def test_blind_spots_of_a_diagnosis_are_asked_for_and_joints_at_rest_ask_for_all(tmp_path):
    path = diagnosis(tmp_path, blind_spots=[{"effect": "cogging_torque"}])
    assert labels(excited(tmp_path / "one", report=path)[0]) == {"sweep"}
    path = diagnosis(tmp_path, blind_spots=[{"effect": "any"}, {"effect": "cogging_torque"}])
    assert len(excited(tmp_path / "all", report=path)[0]["motions"]) == len(FAMILIES)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "expected JSON"),
        ('{"schema": "other/1"}', "schema 'other/1', expected 'gfm.diagnosis/1'"),
        ("[]", "schema None, expected"),
        ('{"schema": "gfm.diagnosis/1"}', "expected verdict, effects and suspects as"),
    ],
)
def test_a_report_that_is_none_is_refused(tmp_path, text, message):
    path = tmp_path / "report.json"
    path.write_text(text)
    with pytest.raises(BadInputError, match=message):
        excited(tmp_path / "out", report=path)
    assert not (tmp_path / "out").exists()


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    lines = [line for line in capsys.readouterr().err.splitlines() if line.strip() != "planning"]
    assert len(lines) == 1
    return lines[0]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--for", "magic"], "unknown effect 'magic'; available: actuator_gain"),
        (["--joint", "elbow"], "unknown joint 'elbow'; available: joint"),
        (["--pose", "home"], "unknown keyframe 'home'; available: none"),
        (["--report", "absent.json"], "report absent.json: no such file"),
        (["--seconds", "1"], "seconds is 1, expected 8 to 600"),
        (["--control-hz", "5"], "--control-hz is 5, expected 10 to 500"),
        (["--clearance", "-1"], "--clearance is -1, expected 0 to 1"),
        (["--range", "joint=2:1"], "--range joint=2:1: expected JOINT=LOW:HIGH"),
        (["--range", "joint=1:2"], "joint joint begins at 0, expected 1.05 to 1.95"),
        (["--max-velocity", "fast"], "--max-velocity fast: expected [JOINT=]VALUE"),
        (["--max-velocity", "elbow=1"], "unknown joint 'elbow'"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(words, message, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["excite", "--model", str(PENDULUM), "--out", str(out), *words]) == 2
    assert message in one_line(capsys)
    assert not out.exists()


def test_without_a_model_or_a_folder_the_line_says_what_is_missing(tmp_path, capsys):
    assert main(["excite", "--out", str(tmp_path / "out")]) == 2
    assert one_line(capsys) == "error: expected --model and --out (or --list)"
    absent = tmp_path / "absent.xml"
    assert main(["excite", "--model", str(absent), "--out", str(tmp_path / "out")]) == 2
    assert one_line(capsys) == f"error: model {absent}: no such file; expected MJCF or URDF"
    (tmp_path / "file").touch()
    assert main(["excite", "--model", str(PENDULUM), "--out", str(tmp_path / "file")]) == 2
    assert "is a file; expected a folder" in one_line(capsys)


def test_the_list_names_every_motion_and_needs_no_model(capsys):
    assert main(["excite", "--list"]) == 0
    assert "ladder" in capsys.readouterr().out
    console = Console(file=io.StringIO(), width=300)
    print_families(console)
    printed = console.file.getvalue()
    for family in FAMILIES:
        assert family.words in printed
        assert ", ".join(family.shows) in printed


def test_values_are_for_one_joint_or_for_all():
    assert joint_values("--x", ["0.5", "a=1", "b=c=2"]) == {"": 0.5, "a": 1.0, "b=c": 2.0}
    assert joint_ranges(["a=-1:0.5"]) == {"a": (-1.0, 0.5)}
    for words in ("a", "a=1", "a=1:nan", "=1:2"):
        with pytest.raises(ConfigError, match="expected JOINT=LOW:HIGH"):
            joint_ranges([words])


def test_kinds_of_command_can_be_chosen(tmp_path):
    plan, _ = excited(
        tmp_path, effects=("cogging_torque",), kinds=(CommandKind.POSITION, CommandKind.VELOCITY)
    )
    assert [one["command"] for one in plan["motions"]] == [
        *("position", "velocity"),
        *("position", "position", "velocity", "velocity"),
    ]
