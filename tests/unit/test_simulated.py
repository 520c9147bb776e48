"""What was simulated before is known; what was asked for longest ago is forgotten."""

import numpy as np
import pytest

from gfm.diagnosis.residuals.simulated import Simulated
from gfm.sim.segment import Prediction
from one_joint import TIME_S, problem

FIRST, SECOND = (problem(np.full((len(TIME_S), 1), x)).segments[0] for x in (0.0, 1.0))
SIZE = 2 * 8 * len(TIME_S)


class Simulator:
    """Predicts a number of its own each time, and keeps which models it was asked for."""

    def __init__(self):
        self.asked = []

    def __call__(self, models, segments, simulated):
        def simulate(new):
            self.asked.append([models[i] for i in new])
            return [[self._prediction() for _ in segments] for _ in new]

        return simulated.each(models, segments, simulate)

    def _prediction(self):
        values = np.full((len(TIME_S), 1), float(len(self.asked)))
        return Prediction(position=values, effort=values.copy(), diverged=False)


@pytest.fixture
def simulator():
    return Simulator()


def test_what_is_known_is_told_again_and_only_the_rest_is_simulated(simulator):
    simulated = Simulated()
    (a,) = simulator(["a"], [FIRST, SECOND], simulated)
    again, b = simulator(["a", "b"], [SECOND, FIRST], simulated)
    assert simulator.asked == [["a"], ["b"]]
    assert again == [a[1], a[0]]
    assert b[0].position[0] == 2.0


def test_a_model_of_which_one_segment_is_unknown_is_simulated(simulator):
    simulated = Simulated()
    simulator(["a"], [FIRST], simulated)
    (both,) = simulator(["a"], [FIRST, SECOND], simulated)
    assert simulator.asked == [["a"], ["a"]]
    assert simulator(["a"], [FIRST, SECOND], simulated) == [both]


def test_what_was_asked_for_longest_ago_is_forgotten(simulator):
    simulated = Simulated(most_bytes=2 * SIZE)
    for models in (["a", "b"], ["a"], ["c"], ["a", "b"]):
        simulator(models, [FIRST], simulated)
    assert simulator.asked == [["a", "b"], ["c"], ["b"]]


def test_what_does_not_fit_is_told_all_the_same(simulator):
    simulated = Simulated(most_bytes=SIZE - 1)
    assert len(simulator(["a", "b"], [FIRST, SECOND], simulated)) == 2
    simulator(["b"], [SECOND], simulated)
    assert simulator.asked == [["a", "b"], ["b"]]


def test_nobody_changes_what_is_known(simulator):
    ((prediction,),) = simulator(["a"], [FIRST], Simulated())
    with pytest.raises(ValueError, match="read-only"):
        prediction.position[0] = 5.0
