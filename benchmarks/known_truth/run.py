"""What is simulated, and what comes of it.

Shape letters: J joints, C commands, T measurements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from known_truth.amounts import Hidden
from known_truth.planted import Planted
from known_truth.robots import Array, Robot

#: Time step, s. All times of commands and measurements are multiples of it, or of a finer one.
STEP_S = 5e-4


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One robot to be driven once.

    Attributes:
        robot: Its nominal numbers.
        kind: Of its commands: position, velocity or effort.
        hidden: What it has beyond the model.
        start: Where it is held at first, rad, shape (J,).
        first_command_step: When commands begin, in time steps from the recording's start.
        command_every: Time steps between commands.
        reference: What is wanted at each command: the commands themselves, or (with effort) the
            positions that a controller is to follow, shape (C, J).
        control: Of that controller: N m/rad and N m s/rad, each of shape (J,).
        measured_at: Time steps of the measurements, increasing, shape (T,).
        step_s: Time step in which all that counts, s.
        explicit: Whether it is integrated explicitly (see `simulation`).
        planted: Torques that nothing has a name for.
    """

    robot: Robot
    kind: str
    hidden: tuple[Hidden, ...]
    start: Array
    first_command_step: int
    command_every: int
    reference: Array
    control: tuple[Array, Array]
    measured_at: NDArray[np.intp]
    step_s: float = STEP_S
    explicit: bool = False
    planted: Planted | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """What a robot did, exactly.

    Attributes:
        position: As an ideal encoder reports it, rad, shape (T, J).
        velocity: rad/s, shape (T, J).
        servo: Torque of the servos, N m, shape (T, J).
        effort: The same with gravity compensation: what drives report, N m, shape (T, J).
        command: What was commanded, shape (C, J).
    """

    position: Array
    velocity: Array
    servo: Array
    effort: Array
    command: Array
