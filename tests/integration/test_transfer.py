"""The loop on a task: what is there is not made again, and what is missing is."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from gfm.api.provenance import sha256
from gfm.cli import main
from gfm.diagnosis.output.correction import model_pair
from gfm.effects import EffectInstance, find_effect
from gfm.envs.registry import as_trained, nominal_cell
from gfm.experiments.attempt_files import Kept
from gfm.experiments.attempts import Attempt
from gfm.experiments.payload import bearing_payload, named_payload
from gfm.policies import shipped_policy
from gfm.recording.weights_file import read_weights, write_weights
from gfm.report.files import model_texts, write_texts
from gfm.sim.plant import native_spec
from gfm.sim.sawyer import JOINT_NAMES

POSITION, POLICY = "position_matching", "policy_adapted.npz"
FOUND = {
    "verdict": "explained",
    "sentence": "The model misses a payload.",
    "effects": [{"effect": "payload"}],
}


def attempts_in(
    folder: Path, policy: Path, outcomes: list[str], model: str = "", recorded: bool = True
) -> None:
    about = {
        "task": POSITION,
        "policy": sha256(policy),
        "model": model,
        "robot": "sim",
        "hidden_effect": "payload",
        "robot_config": "",
        "clock": "lockstep",
        "seed": 3,
    }
    kept = Kept(folder, about)
    for trial, outcome in enumerate(outcomes):
        kept.add(
            Attempt(
                goal=0,
                trial=trial,
                outcome=outcome,
                steps=20,
                place_m=0.01,
                turn_rad=0.1,
                path=[[0.6, 0.0], [0.65, 0.0]],
                recording=f"{trial}.mcap" if recorded else "",
            )
        )


@pytest.fixture
def words(tmp_path: Path) -> list[str]:
    size = ["--goals", "1", "--trials", "2", "--out", str(tmp_path)]
    return ["transfer", "--task", "position", "--hidden-effect", "payload", "--seed", "3", *size]


def made(folder: Path, effects: list[dict[str, str]]) -> None:
    """Makes the steps of a campaign."""
    before, after = shipped_policy(POSITION), folder / POLICY
    attempts_in(folder / "before", before, ["out_of_time", "reached"])
    (folder / "diagnosis").mkdir()
    (folder / "diagnosis" / "report.json").write_text(json.dumps(FOUND | {"effects": effects}))
    weights = read_weights(before)
    write_weights(after, replace(weights, version=weights.version + 1))
    corrected = folder / "corrected.xml"
    write_texts(folder, model_texts("corrected", model_pair(nominal_cell(POSITION), ())))
    attempts_in(folder / "after_adapted", after, ["reached", "reached"], sha256(corrected))


def there_before(folder: Path) -> list[Path]:
    """Returns the files of a campaign that cost time."""
    return [*folder.rglob("*.npz"), *folder.glob("*.xml"), *folder.glob("diagnosis/*")]


def test_steps_that_are_there_are_not_made_again(
    tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    made(tmp_path, FOUND["effects"])
    there = {path: path.stat().st_mtime_ns for path in there_before(tmp_path)}
    assert main(words) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "1 of 2 as it came; 2 of 2 adapted to the corrected model" in said
    document = json.loads((tmp_path / "report.json").read_text())
    assert document["diagnosis"]["sentence"] == FOUND["sentence"]
    assert document["before"]["success"]["reached"] == 1
    assert document["after"]["adapted"]["success"]["reached"] == 2
    page = (tmp_path / "report.html").read_text()
    assert "Ways of the object: as it came" in page
    assert {path: path.stat().st_mtime_ns for path in there} == there


def test_nothing_is_trained_on_a_model_that_was_not_corrected(
    tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    made(tmp_path, [])
    assert main(words) == 0
    assert "nothing was named" in capsys.readouterr().out
    assert json.loads((tmp_path / "report.json").read_text())["after"] == {}


def test_attempts_of_which_nothing_is_recorded_are_refused(
    tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    outcomes = ["out_of_time", "out_of_time"]
    attempts_in(tmp_path / "before", shipped_policy(POSITION), outcomes, recorded=False)
    assert main([*words, "--air-seconds", "0"]) == 2
    assert "0 attempts to learn from and 0 that judge" in capsys.readouterr().err
    assert not (tmp_path / "diagnosis").exists()


def test_another_campaign_in_the_folder_is_refused(
    tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    made(tmp_path, FOUND["effects"])
    assert main([*words, "--seed", "4"]) == 2
    assert "made with seed 3, asked for 4" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--trials", "1"], "--trials is 1, expected at least 2"),
        (["--minutes", "0"], "--minutes is 0, expected more than 0"),
        (["--learner-steps", "0"], "--learner-steps is 0, expected at least 1"),
        (["--air-seconds", "3"], "--air-seconds is 3, expected 0, or 8 to 600"),
    ],
)
def test_settings_out_of_range_are_refused(
    words: list[str], given: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, *given]) == 2
    assert said in capsys.readouterr().err


def test_training_steps_the_corrected_cell_as_the_nominal_one() -> None:
    nominal = nominal_cell(POSITION)
    corrected = nominal.copy()
    corrected.joint("right_j1").frictionloss = 2.2
    corrected.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model = as_trained(corrected, POSITION).compile()
    assert model.opt.integrator == nominal.option.integrator
    assert model.joint("right_j1").frictionloss == pytest.approx(2.2)
    assert corrected.option.integrator == mujoco.mjtIntegrator.mjINT_RK4


LOAD = {"mass": 0.6, "com_x": 0.01, "com_y": 0.02, "com_z": 0.1}
NAMED = {"effect": "payload", "parameters": {name: {"value": x} for name, x in LOAD.items()}}


def test_the_robot_is_told_of_the_payload_that_was_named() -> None:
    friction = {"effect": "coulomb_friction", "parameters": {"torque": {"value": 1.0}}}
    payload = named_payload({"effects": [friction, NAMED]})
    assert payload is not None
    assert str(payload) == "0.6 kg at 0.01, 0.02, 0.1 m"
    assert named_payload({"effects": [friction]}) is None


def test_a_model_whose_robot_was_told_bears_its_payload() -> None:
    named = EffectInstance(effect=find_effect("payload"), joints=("right_j6",), values=LOAD)
    corrected = native_spec(nominal_cell(POSITION), [named])
    told = bearing_payload(corrected).compile()
    data = mujoco.MjData(told)
    mujoco.mj_forward(told, data)
    arm = slice(0, len(JOINT_NAMES))
    assert data.qfrc_gravcomp[arm] == pytest.approx(data.qfrc_bias[arm])
    assert corrected.body("payload").gravcomp == 0.0


def test_without_a_payload_there_is_nothing_to_tell(
    tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    made(tmp_path, [{"effect": "coulomb_friction"}])
    assert main([*words, "--treatments", "told"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "no payload was named: there is nothing to tell the robot" in said
    assert json.loads((tmp_path / "report.json").read_text())["after"] == {}


@pytest.mark.slow
def test_the_whole_loop_as_processes(tmp_path: Path, words: list[str]) -> None:
    short = ["--treatments", "nominal", "--learner-steps", "40", "--minutes", "0.5"]
    assert main([*words, *short]) == 0
    document = json.loads((tmp_path / "report.json").read_text())
    assert document["before"]["success"]["of"] == 2
    assert (tmp_path / "diagnosis" / "report.html").is_file()
    assert document["after"]["nominal"]["success"]["of"] == 2
    experiment = tomllib.loads((tmp_path / "training_nominal.toml").read_text())
    assert experiment["learner_steps"] == 40
    began, ended = (
        read_weights(path) for path in (shipped_policy(POSITION), tmp_path / "policy_nominal.npz")
    )
    changed = [bool((began.tensors[k] != ended.tensors[k]).any()) for k in began.tensors]
    assert not any(changed)  # the critic learns alone at first: it went on from that policy
