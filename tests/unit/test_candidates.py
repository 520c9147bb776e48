"""Which orders of a cogging torque are looked for, on missing torques made of known waves."""

import numpy as np
import pytest

from gfm.diagnosis.candidates import TorqueView, cogging_orders

TIME_S = np.arange(0.0, 12.0, 0.01)


def view(span, torque):
    """Returns a joint's way back and forth over `span`, and what is missing along it."""
    way = np.sin(1.7 * TIME_S) * np.sin(0.31 * TIME_S + 0.5)
    position = -1.2 + span * way / np.ptp(way)
    velocity = np.gradient(position, TIME_S)
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(TIME_S))
    missing = torque(position, velocity) + noise
    return TorqueView(
        position=position[:, None],
        velocity=velocity[:, None],
        drive=np.zeros((len(position), 1)),
        missing=missing[:, None],
    )


def test_an_order_is_found_from_less_than_a_period():
    """12 waves per turn over 0.42 rad: one crest, one trough."""
    seen = view(0.42, lambda q, _v: 1.9 * np.sin(12 * q - 1.0))
    assert 12 in cogging_orders([seen], 0)


@pytest.mark.parametrize("order", [15, 40])
def test_an_order_is_found_beside_a_spring_and_friction(order):
    def torque(q, v):
        return 0.3 * np.sin(order * q) - 20.0 * q - 0.5 * v - 0.4 * np.tanh(v / 0.01)

    assert order in cogging_orders([view(1.0, torque)], 0)


def test_what_the_motion_does_not_cover_is_not_looked_for():
    seen = view(0.42, lambda q, _v: np.sin(8 * q))
    assert min(cogging_orders([seen], 0)) * 0.42 >= 0.75 * 2.0 * np.pi
