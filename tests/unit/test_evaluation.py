"""The test of a policy: what counts, what is kept, what is said."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from gfm.core import BadInputError, ConfigError
from gfm.envs.evaluation import evaluate
from gfm.envs.matching_task import POSE_MATCHING, POSITION_MATCHING
from gfm.envs.outcomes import Outcome
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings, arm_problem
from gfm.experiments.evaluate import EvaluationRequest
from gfm.report.evaluation import Evaluation, evaluation_json, evaluation_texts, print_evaluation

SHORT = replace(POSITION_MATCHING, steps=25)


@pytest.fixture(scope="module")
def arm():
    return arm_problem("position_matching", EnvironmentSettings(), EnvironmentAssets())


def constant(**joints):
    action = np.zeros(7, np.float32)
    for joint, value in joints.items():
        action[int(joint[1:])] = value
    return lambda observation: np.tile(action, (len(observation), 1))


@pytest.fixture(scope="module")
def mixed(arm):
    """Goals near enough to be reached at once and others, by an arm that stays."""
    task = replace(SHORT, goal_radius_m=0.03, tolerance_m=0.0301)
    return task, evaluate(task, arm, constant(), trials=2, seed=1)


def test_an_arm_that_stays_is_out_of_time_at_every_goal(arm):
    attempts = evaluate(SHORT, arm, constant(), trials=2, seed=0)
    assert (attempts.outcome == Outcome.OUT_OF_TIME).all()
    assert (attempts.steps == SHORT.steps).all()
    np.testing.assert_allclose(attempts.place, SHORT.goal_radius_m, atol=0.008)
    assert attempts.goal.tolist() == [number for number in range(10) for _ in range(2)]
    assert attempts.path.shape == (20, SHORT.steps + 1, 2)
    assert np.isfinite(attempts.path).all()


def test_a_goal_that_is_held_counts_after_ten_steps_and_ends_the_attempt(arm):
    task = replace(SHORT, tolerance_m=0.2)
    attempts = evaluate(task, arm, constant(), trials=1, seed=0)
    assert attempts.reached.all()
    assert (attempts.steps == 10).all()
    assert attempts.time_s.tolist() == [0.5] * 10
    assert attempts.path.shape[1] == 11


def test_decided_attempts_stay_as_they_were_while_others_go_on(mixed):
    _, attempts = mixed
    reached = attempts.reached
    assert 0 < reached.sum() < len(reached)
    assert (attempts.steps[reached] == 10).all()
    assert np.isnan(attempts.path[reached][:, 11:]).all()
    assert (attempts.qpos[10:, reached] == attempts.qpos[10, reached]).all()
    assert attempts.reached[attempts.best]
    assert not attempts.reached[attempts.worst]
    assert attempts.place[attempts.worst] == attempts.place[~reached].max()


def test_leaving_the_workspace_is_a_reason(arm):
    fast = evaluate(replace(SHORT, steps=200), arm, constant(j3=-1.0), trials=1, seed=0)
    assert (fast.outcome == Outcome.TOOL_LEFT_WORKSPACE).all()
    evaluation = Evaluation(task=SHORT, attempts=fast, trials=1, provenance={})
    assert evaluation.failures == {"the tool left its workspace": 10}
    assert evaluation.reached == 0


def test_equal_seeds_give_equal_attempts(arm):
    runs = [evaluate(SHORT, arm, constant(j0=1.0), trials=1, seed=seed) for seed in (3, 3, 4)]
    np.testing.assert_array_equal(runs[0].qpos, runs[1].qpos)
    assert (runs[0].qpos != runs[2].qpos).any()


def test_a_policy_that_is_not_finite_is_refused(arm):
    with pytest.raises(BadInputError, match="actions are not finite"):
        evaluate(SHORT, arm, constant(j0=np.nan), trials=1, seed=0)


@pytest.mark.parametrize(
    ("reached", "of", "low", "high"), [(0, 50, 0.0, 0.0713), (45, 50, 0.7864, 0.9565)]
)
def test_the_interval_is_wilsons(mixed, reached, of, low, high):
    task, attempts = mixed
    outcome = np.where(np.arange(of) < reached, Outcome.REACHED, Outcome.OUT_OF_TIME)
    evaluation = Evaluation(
        task=task, attempts=replace(attempts, outcome=outcome), trials=5, provenance={}
    )
    assert evaluation.interval == pytest.approx((low, high), abs=1e-4)


def test_the_document_says_what_happened_at_every_goal(mixed):
    task, attempts = mixed
    evaluation = Evaluation(task=task, attempts=attempts, trials=2, provenance={"seed": 1})
    document = evaluation_json(evaluation)
    assert document["schema"] == "gfm.evaluation/1"
    assert document["success"]["reached"] == attempts.reached.sum()
    assert sum(line["reached"] for line in document["goals"]) == attempts.reached.sum()
    assert [line["of"] for line in document["goals"]] == [2] * 10
    assert sum(document["failures"].values()) == (~attempts.reached).sum()
    assert len(document["attempts"]) == 20
    texts = evaluation_texts(evaluation)
    assert set(texts) == {"report.json", "report.html"}
    assert evaluation.sentence in texts["report.html"].replace("&#39;", "'")
    console = Console(record=True, width=100)
    print_evaluation(console, evaluation)
    assert "out of time" in console.export_text()


def test_pages_of_poses_tell_the_yaw():
    arm = arm_problem("pose_matching", EnvironmentSettings(), EnvironmentAssets())
    attempts = evaluate(replace(POSE_MATCHING, steps=2), arm, constant(), trials=1, seed=0)
    evaluation = Evaluation(task=POSE_MATCHING, attempts=attempts, trials=1, provenance={})
    lines = evaluation.lines()
    assert [line.yaw_deg for line in lines] == pytest.approx([60.0, -60.0] * 5)
    assert all(50.0 < line.left_deg < 70.0 for line in lines)
    assert "median yaw left" in evaluation_texts(evaluation)["report.html"]


def test_no_attempts_at_all_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="--trials is 0, expected at least 1"):
        EvaluationRequest(task="position_matching", policy=tmp_path, trials=0)
