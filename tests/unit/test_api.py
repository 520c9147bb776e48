"""What `import gfm` offers, on pendulums that MuJoCo recorded."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import gfm
from gfm.core import BadInputError, ConfigError, RecordingError, UnknownNameError
from gfm.diagnosis.output.result import ModelPair, NamedEffect, ParameterEstimate
from gfm.recording import write_recording
from gfm.service.model_files import read_model

PAGE = Path(__file__).parents[2] / "docs" / "python.md"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Runs the page's example as a reader would, in a folder of its own; returns its names."""
    names: dict[str, object] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("reader"))
        for block in re.findall(
            r"^```python\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE
        ):
            exec(block, names)
        names["folder"] = Path.cwd()
    return names


def test_the_page_s_example_finds_what_it_says(page):
    assert page["diagnosis"].verdict == "explained"
    effect = page["effect"]
    assert (effect.effect, effect.joints) == ("viscous_friction", ("elbow",))
    assert effect.parameters["coefficient"].value == pytest.approx(0.8, rel=0.02)
    low, high = effect.parameters["coefficient"].ci95
    assert low < 0.8 < high
    (row,) = page["rows"]
    assert (row["effect"], row["low"], row["high"]) == ("viscous_friction", low, high)
    files = {path.name for path in (page["folder"] / "diagnosis").iterdir()}
    assert files == {"report.html", "report.json", "corrected.xml"}
    assert page["robot"].dof_damping.ravel()[0] == pytest.approx(1.0, rel=0.02)


def test_errors_of_rollouts_are_those_of_the_diagnosis(page):
    diagnosis, before, after = page["diagnosis"], page["before"], page["after"]
    assert before.rmse == pytest.approx(diagnosis.error.before, rel=0.01)
    assert after.rmse == pytest.approx(diagnosis.error.after, rel=0.05)
    assert before.joints == {"elbow": pytest.approx(before.rmse)}
    assert list(before.recordings) == ["run2"]


def test_errors_of_rollouts_can_begin_as_measured(page):
    told = gfm.rollout_error(page["spec"], page["run2"], as_measured=True)
    assert told.rmse == pytest.approx(page["diagnosis"].answer.as_measured.after, rel=0.05)


def test_a_diagnosis_shows_itself(page):
    diagnosis = page["diagnosis"]
    assert repr(diagnosis) == "<Diagnosis explained: viscous friction (elbow)>"
    assert "viscous friction" in str(diagnosis)
    shown = diagnosis._repr_html_()
    assert "viscous friction" in shown
    assert "<script" not in shown
    assert "<style" not in shown


def test_what_a_notebook_shows_escapes_names(page):
    answer = page["diagnosis"].answer
    joints = {"<img src=x>": answer.error}
    assert (
        "<img"
        not in replace(page["diagnosis"], answer=replace(answer, joints=joints))._repr_html_()
    )


def test_a_plot_of_an_effect_without_evidence_names_those_that_have_some(page):
    assert page["errors"].data
    assert page["evidence"].data
    with pytest.raises(UnknownNameError, match=r"'backlash'; available: (?!,).*viscous"):
        page["diagnosis"].plot("backlash")


def test_recordings_in_memory_are_told_by_name(page):
    told = page["diagnosis"].answer.provenance
    assert told["in_memory"]["recording"] == ["run0", "run1"]
    assert [one["role"] for one in told["files"]] == ["model"]


def test_a_corrected_model_keeps_what_mjcf_cannot_say(page):
    beside = NamedEffect(
        effect="load_dependent_friction",
        joints=("elbow",),
        parameters={"coefficient": ParameterEstimate(value=0.25, unit="1", ci95=None)},
        confidence=1.0,
        native=False,
    )
    answer = replace(page["diagnosis"].answer, corrected_effects=(beside,))
    diagnosis = replace(page["diagnosis"], answer=answer)
    diagnosis.save(page["folder"] / "pair")
    read = read_model(page["folder"] / "pair" / "corrected.xml")
    assert diagnosis.corrected_model.effects == read.effects
    assert [one.effect.name for one in read.effects] == ["load_dependent_friction"]


def test_models_for_two_kinds_of_command_stay_two(page):
    answer = page["diagnosis"].answer
    spec = mujoco.MjSpec.from_string(answer.corrected_xml)
    for drive in spec.actuators:
        drive.set_to_motor()
    spec.compile()
    effort = spec.to_xml()
    twins = {
        "position": ModelPair(xml=answer.corrected_xml, effects=()),
        "effort": ModelPair(xml=effort, effects=()),
    }
    told = replace(page["diagnosis"], answer=replace(answer, twins=twins)).corrected_model
    assert set(told.specs) == {"position", "effort"}


def test_a_spec_is_a_model_and_stays_as_it_is(page):
    spec = mujoco.MjSpec.from_file(str(page["folder"] / "pendulum.xml"))
    spec.actuators[0].name = "servo"
    told = gfm.rollout_error(spec, page["run2"])
    assert told.rmse == pytest.approx(page["before"].rmse)
    assert spec.actuators[0].name == "servo"


def test_what_is_open_decides_what_is_excited(page):
    model = str(page["folder"] / "pendulum.xml")
    asked = gfm.excite(model, report=page["folder"] / "diagnosis" / "report.json", seconds=8)
    same = gfm.excite(model, report=page["diagnosis"], seconds=8)
    names = [[one.motion.name for one in plan.plan.motions] for plan in (asked, same)]
    assert names[0] == names[1]
    assert page["excitation"].plan.request.effects == ("backlash",)
    assert (page["folder"] / "plan" / "plan.html").is_file()


def test_a_table_is_loaded_by_the_model_s_joints(page, tmp_path):
    run = page["run0"]
    rows = np.column_stack([run.time_s, run.position, run.command])
    header = "time,elbow_position,elbow_command"
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=header, comments="")
    model = page["folder"] / "pendulum.xml"
    (read,) = gfm.load(tmp_path, model=model)
    np.testing.assert_allclose(read.position, run.position)
    np.testing.assert_allclose(read.command, run.command)
    (other,) = gfm.load(tmp_path / "run.csv", model=mujoco.MjSpec.from_file(str(model)))
    np.testing.assert_array_equal(other.position, read.position)


def test_a_recording_is_read_as_one_though_a_model_is_given(page):
    path = page["folder"] / "recordings" / "run0.mcap"
    (read,) = gfm.load(path, model=page["folder"] / "pendulum.xml")
    np.testing.assert_array_equal(read.position, page["run0"].position)


def test_what_cannot_be_used_is_one_line(page, tmp_path):
    model, run = page["folder"] / "pendulum.xml", page["run0"]
    cases = [
        (lambda: gfm.load(tmp_path), RecordingError, r"no file in it ends with \.mcap; expected"),
        (lambda: gfm.load(tmp_path / "none.mcap"), RecordingError, "no such file"),
        (lambda: gfm.load("a", model=model, mapping="b"), ConfigError, "both model and mapping"),
        (lambda: gfm.load([], model=model), ConfigError, "no recordings; expected at least one"),
        (lambda: gfm.load("run.csv"), ConfigError, "run.csv: is another tool's; expected model="),
        (lambda: gfm.load(run), ConfigError, "run0 is a recording already"),
        (lambda: gfm.diagnose("none.xml", run), BadInputError, "model none.xml: no such file"),
        (lambda: gfm.diagnose(page["robot"], run), ConfigError, "model is a MjModel, expected"),
        (lambda: gfm.diagnose(model, []), ConfigError, "no recordings; expected at least one"),
        (lambda: gfm.rollout_error(model, []), ConfigError, "no recordings; expected at least one"),
        (lambda: gfm.diagnose(model, run, minutes=0), ConfigError, "minutes is 0, expected"),
        (lambda: gfm.diagnose(model, run, holdout=run), RecordingError, "run0: is the same as"),
        (lambda: gfm.excite(model, effects=["rust"]), UnknownNameError, "unknown effect 'rust'"),
    ]
    for call, error, words in cases:
        with pytest.raises(error, match=words):
            call()


def test_a_recording_that_is_written_again_is_not_another_one(page, tmp_path):
    write_recording(tmp_path / "again.mcap", page["run0"])
    with pytest.raises(ConfigError, match="are the same; expected different"):
        gfm.diagnose(
            page["folder"] / "pendulum.xml",
            [page["folder"] / "recordings" / "run0.mcap", tmp_path / "again.mcap"],
        )


def test_importing_loads_nothing_that_takes_time():
    code = "import sys, gfm; dir(gfm); print(*({'numpy', 'mujoco', 'rich'} & set(sys.modules)))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == ""


def test_a_diagnosis_needs_no_messages_between_processes():
    code = "import sys, gfm; gfm.diagnose; import gfm.report; print('zenoh' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "False"


def test_everything_that_is_offered_is_there_and_nothing_else():
    assert all(hasattr(gfm, name) for name in gfm.__all__)
    assert set(gfm.__all__) <= set(dir(gfm))
    with pytest.raises(AttributeError, match="module 'gfm' has no attribute 'nonsense'"):
        gfm.nonsense  # noqa: B018
