"""A joint at rest that answers a step tells how long it waited."""

from dataclasses import replace

import numpy as np
import pytest

from gfm.diagnosis.data.segmentation import make_problem
from gfm.diagnosis.residuals.step_response import ANSWER_S, dead_time, dead_time_s, find_answers
from late_pendulum import DELAY, SPECS, instance, recordings


@pytest.mark.parametrize("dead", [0.0, 0.004, 0.013, 0.05])
@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_joint_that_is_pulled_from_rest_tells_when(dead, up):
    time_s = 0.01 * np.arange(40.0)
    moved = 0.5 * 30.0 * np.maximum(time_s - 0.1 - dead, 0.0) ** 2
    assert dead_time_s(time_s, 0.3 + up * moved, 0.1, up, 1e-4) == pytest.approx(dead, abs=1e-9)


def test_what_does_not_move_or_moves_the_other_way_answers_nothing():
    time_s = 0.01 * np.arange(40.0)
    moved = np.maximum(time_s - 0.1, 0.0) ** 2
    assert np.isnan(dead_time_s(time_s, np.zeros(40), 0.1, 1.0, 1e-4))
    assert np.isnan(dead_time_s(time_s, -moved, 0.1, 1.0, 1e-4))
    assert np.isnan(dead_time_s(time_s, moved, -1.0, 1.0, 1e-4))


def test_dead_time_is_what_all_joints_share_and_no_chance():
    late = np.array([0.019, 0.021, 0.02, 0.018, 0.022, 0.02, 0.019, 0.021])
    all_of_one = [list(range(8))]
    assert dead_time(late, [[0, 1, 2, 3], [4, 5, 6, 7]]) == pytest.approx(0.02)
    assert dead_time(np.append(late, -late[:3]), [list(range(8)), [8, 9, 10]]) is None
    assert dead_time(1e-3 * np.array([5.0, -4, 6, -5, 4, -6, 5, -4]), all_of_one) is None
    assert dead_time(0.05 * late, all_of_one) is None
    assert dead_time(late[:7], [list(range(7))]) is None


def test_answers_are_found_where_commands_step_from_rest_and_nowhere_else():
    runs = recordings(DELAY)
    problem = make_problem(SPECS, runs)
    found = find_answers(problem, runs)
    assert 20 <= len(found.answers) <= 26
    assert {s.recording for s in found.problem.segments} == {1, 3}
    assert np.median([one.after_s for one in found.answers]) == pytest.approx(DELAY, abs=2e-3)
    off = [replace(one, servo_gain={"j": 0.0}) for one in runs]
    assert find_answers(problem, off).answers == ()


def test_a_prediction_without_an_answer_counts_as_a_late_one():
    runs = recordings(DELAY)
    found = find_answers(make_problem(SPECS, runs), runs)
    late = found.late_s([(instance("coulomb_friction", 100.0),)])[0]
    expected = [one.after_s - ANSWER_S for one in found.answers]
    np.testing.assert_allclose(late, expected)
