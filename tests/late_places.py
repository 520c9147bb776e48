"""A pendulum that is late somewhere, integrated by SciPy: what tests of delays are made from.

It shares neither code nor integrator with what is tested on it. It begins at rest, where it hangs,
and has hung there for ever.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

from gfm.core import CommandKind, Trajectory
from pendulum import DAMPING, LENGTH, MASS, PERIOD_S, ROTOR, STIFFNESS

LINK = MASS * LENGTH**2
#: Pieces in which it is integrated: what was felt before a piece has to be known, s.
PIECE_S = 0.0025
POSITION_NOISE, EFFORT_NOISE = 1e-4, 0.02


@dataclass(frozen=True, kw_only=True)
class Late:
    """By how much what is late, s, and the spring between motor and link, N m/rad."""

    command: float = 0.0
    servo: float = 0.0
    position: float = 0.0
    effort: float = 0.0
    clock: float = 0.0
    spring: float = np.inf


@dataclass
class Swing:
    """The true motion, on the clock of the commands."""

    told: np.ndarray
    late: Late
    feedback: bool = True
    pieces: list = field(default_factory=list)

    def state(self, time_s):
        """Returns angle and speed of the motor, then of the link."""
        if time_s <= 0.0:
            return np.zeros(4)
        return self.pieces[min(int(time_s / PIECE_S), len(self.pieces) - 1)](time_s)

    def commanded(self, time_s):
        index = int(np.floor((time_s - self.late.command - self.late.servo) / PERIOD_S + 1e-9))
        return 0.0 if index < 0 else self.told[min(index, len(self.told) - 1)]

    def drive(self, time_s, now=None):
        """Returns the torque of the drive, of what it feels `now` if it is in time."""
        if not self.feedback:
            return self.commanded(time_s)
        felt = now if now is not None and not self.late.servo else None
        q, v = (self.state(time_s - self.late.servo) if felt is None else felt)[:2]
        return STIFFNESS * (self.commanded(time_s) - q) - DAMPING * v

    def motion(self, time_s, now):
        q_motor, v_motor, q, v = now
        drive, weight = self.drive(time_s, now), MASS * 9.81 * LENGTH * np.sin(q)
        if np.isinf(self.late.spring):
            bend = (drive - weight) / (LINK + ROTOR)
            return [v_motor, bend, v, bend]
        spring = self.late.spring * (q_motor - q)
        return [v_motor, (drive - spring) / ROTOR, v, (spring - weight) / LINK]

    def integrate(self, until_s):
        assert self.late.servo == 0.0 or self.late.servo >= PIECE_S
        while len(self.pieces) * PIECE_S < until_s:
            start = len(self.pieces) * PIECE_S
            span, now = (start, start + PIECE_S), self.state(start)
            # A command may change within a piece, and no step may go over it.
            answer = solve_ivp(
                self.motion, span, now, max_step=PIECE_S / 2, rtol=1e-6, dense_output=True
            )
            self.pieces.append(answer.sol)
        return self


def late_run(told, late, *, seed, feedback=True) -> Trajectory:
    """Returns what is recorded when it is `told` angles every 10 ms, or torques without feedback.

    What is late comes in multiples of half a piece, so that commands change between two steps.
    """
    stamps = PERIOD_S * np.arange(len(told))
    swing = Swing(told, late, feedback).integrate(stamps[-1] + 0.1)
    position = [swing.state(t - late.clock - late.position)[2] for t in stamps]
    effort = [swing.drive(t - late.clock - late.effort) for t in stamps]
    rng = np.random.default_rng(seed)
    stamp_ns = np.round(stamps * 1e9).astype(np.int64)
    return Trajectory(
        name=f"run {seed}",
        joint_names=("j",),
        stamp_ns=stamp_ns,
        position=(position + POSITION_NOISE * rng.standard_normal(len(told)))[:, None],
        velocity=None,
        effort=(effort + EFFORT_NOISE * rng.standard_normal(len(told)))[:, None],
        command_kind=CommandKind.POSITION if feedback else CommandKind.EFFORT,
        command_stamp_ns=stamp_ns,
        command=told[:, None],
    )
