"""Attempts to learn from and attempts that judge."""

from gfm.envs.arm import CONTROL_PERIOD_S
from gfm.experiments.attempt_choice import LEARNED_S, judged_on, learned_from
from gfm.experiments.attempts import Attempt


def attempts(steps, goals=10, trials=5):
    return [
        Attempt(
            goal=goal,
            trial=trial,
            outcome="timeout",
            steps=steps,
            place_m=0.1,
            turn_rad=0.0,
            path=[],
            recording=f"{goal}_{trial}",
        )
        for goal in range(goals)
        for trial in range(trials)
    ]


def whole(one):
    return CONTROL_PERIOD_S * one.steps


def places(chosen):
    return [(one.goal, one.trial) for one in chosen]


def test_of_long_attempts_five_first_ones_are_enough():
    assert places(learned_from(attempts(400), whole)) == [(0, 0), (2, 0), (4, 0), (7, 0), (9, 0)]


def test_of_short_attempts_there_are_more_until_they_last_as_long_the_first_ones_first():
    chosen = learned_from(attempts(60), whole)  # three seconds each
    assert len(chosen) == LEARNED_S / 3.0
    assert [one.trial for one in chosen] == 10 * [0] + 10 * [1]
    assert len({*places(chosen)}) == 20


def test_what_judges_is_never_learned_from_however_short_attempts_are():
    made = attempts(1)
    learned, judged = learned_from(made, whole), judged_on(made, whole)
    assert len(learned) == 40
    assert places(judged) == [(0, 4), (2, 4), (4, 4), (7, 4), (9, 4)]
    assert not {*places(learned)} & {*places(judged)}


def test_of_two_trials_the_first_is_learned_from_and_of_few_goals_all_are():
    made = attempts(400, goals=3, trials=2)
    assert places(learned_from(made, whole)) == [(0, 0), (1, 0), (2, 0)]
    assert places(judged_on(made, whole)) == [(0, 1), (1, 1), (2, 1)]


def test_long_attempts_count_for_what_is_recorded_of_them():
    chosen = learned_from(attempts(400), lambda _: 3.0)
    assert len(chosen) == LEARNED_S / 3.0


def test_attempts_without_a_recording_to_learn_from_are_neither_learned_from_nor_judge():
    def recorded(one):
        return 20.0 if one.goal % 2 else 0.0

    made = attempts(400)
    assert places(learned_from(made, recorded)) == [(1, 0), (3, 0), (5, 0), (7, 0), (9, 0)]
    assert places(judged_on(made, recorded)) == [(1, 4), (3, 4), (5, 4), (7, 4), (9, 4)]
    assert learned_from(made, lambda _: 0.0) == judged_on(made, lambda _: 0.0) == []
