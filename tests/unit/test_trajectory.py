"""What a recording says of itself."""

from dataclasses import replace

import numpy as np
import pytest

from gfm.core import CommandKind, Trajectory

MS = 1_000_000
RUN = Trajectory(
    name="run",
    joint_names=("a", "b"),
    stamp_ns=np.array([0, 10, 20, 35]) * MS,
    position=np.zeros((4, 2)),
    velocity=None,
    effort=None,
    command_kind=CommandKind.POSITION,
    command_stamp_ns=np.array([5, 20]) * MS,
    command=np.array([[1.0, 2.0], [3.0, 4.0]]),
)


def test_the_period_is_the_usual_time_between_measurements():
    assert RUN.period_s == pytest.approx(0.01)


def test_a_command_holds_from_its_stamp_on_and_the_first_one_before_it():
    np.testing.assert_array_equal(RUN.held_command, RUN.command[[0, 0, 1, 1]])


@pytest.mark.parametrize("rows", [slice(1, 3), np.array([False, True, True, False])])
def test_a_part_of_the_measurements_keeps_all_commands(rows):
    whole = replace(RUN, position=np.arange(8.0).reshape(4, 2), effort=np.ones((4, 2)))
    part = whole.measured_at(rows)
    np.testing.assert_array_equal(part.stamp_ns, RUN.stamp_ns[1:3])
    np.testing.assert_array_equal(part.position, whole.position[1:3])
    assert part.velocity is None
    assert part.effort is not None
    assert part.effort.shape == (2, 2)
    assert part.command is whole.command
