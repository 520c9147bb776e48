"""`gfm adapt`: a policy does on a corrected model what it did on its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from gfm.cli import main
from gfm.diagnosis.output.correction import model_pair
from gfm.effects import EffectInstance, find_effect
from gfm.envs.evaluation import evaluate
from gfm.envs.matching_task import POSITION_MATCHING
from gfm.envs.registry import nominal_cell
from gfm.experiments import adapt
from gfm.experiments.evaluate import EvaluationRequest, load_arm
from gfm.policies import shipped_policy
from gfm.recording.weights_file import read_weights
from gfm.report.files import model_texts, write_texts
from gfm.rl.policy_numpy import GaussianPolicy

TASK = POSITION_MATCHING.name


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """The cell with a payload on the hand that nothing compensates."""
    amounts = {"mass": 0.6, "com_x": 0.0, "com_y": 0.0, "com_z": 0.1}
    payload = EffectInstance(effect=find_effect("payload"), joints=("right_j6",), values=amounts)
    write_texts(tmp_path, model_texts("corrected", model_pair(nominal_cell(TASK), (payload,))))
    return tmp_path / "corrected.xml"


def words(model: Path, out: Path, *more: str) -> list[str]:
    return ["adapt", "--task", "position", "--model", str(model), "--out", str(out), *more]


def test_the_adapted_policy_is_one_of_the_same_task(
    tmp_path: Path, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(adapt, "_PERIODS", 12)
    monkeypatch.setattr(adapt, "_STEPS_LAST", 20)
    out = tmp_path / "adapted.npz"
    assert main(words(model, out)) == 0
    begun, ended = read_weights(shipped_policy(TASK)), read_weights(out)
    assert ended.spec_digest == begun.spec_digest
    assert ended.architecture == begun.architecture
    assert (ended.tensors["mean.bias"] != begun.tensors["mean.bias"]).any()


def test_a_policy_for_another_task_is_refused(
    tmp_path: Path, model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = shipped_policy("pose_matching")
    assert main(words(model, tmp_path / "out.npz", "--policy", str(other))) == 2
    assert "expected 270 to 7 for position_matching" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out.npz").exists()


def test_a_model_that_is_not_there_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words(tmp_path / "none.xml", tmp_path / "out.npz")) == 2
    assert "none.xml" in capsys.readouterr().err


@pytest.mark.slow
def test_under_a_payload_the_adapted_policy_reaches_more(tmp_path: Path, model: Path) -> None:
    out = tmp_path / "adapted.npz"
    assert main(words(model, out)) == 0
    arm = load_arm(EvaluationRequest(task=TASK, model=model))
    reached = []
    for path in (shipped_policy(TASK), out):
        policy = GaussianPolicy.from_weights(read_weights(path))
        attempts = evaluate(POSITION_MATCHING, arm, policy.mean_action, trials=5, seed=0)
        reached.append(int(attempts.reached.sum()))
    assert reached[1] > reached[0]
