"""What tests of models with two joints share."""

import numpy as np

from gfm.core import CommandKind
from gfm.sim.segment import Segment


def a_segment(servo_gain=(1.0, 1.0)):
    """A second in which both joints are told to swing."""
    time_s = np.arange(0.0, 1.0, 0.01)
    command = np.stack([0.4 * np.sin(5.0 * time_s), 0.3 * np.cos(4.0 * time_s)], axis=1)
    return Segment(
        time_s=time_s,
        position=command,
        effort=None,
        kind=CommandKind.POSITION,
        command_time_s=time_s + 0.0007,
        command=command,
        initial_position=command[0],
        initial_velocity=np.array([2.0, 0.0]),
        servo_gain=np.array(servo_gain),
    )
