"""What comes late, by its place: commands, servos, channels of sensors, clocks.

Recordings tell when positions and efforts were reported, and when commands were issued: which place
was late they tell only as far as that moves one of these against another (`Shift`). Whoever has
positions alone sees the same of a late command, a late position and a clock that is ahead.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import final

import mujoco
from typing_extensions import override

from gfm.core.checks import Array
from gfm.effects.effect import (
    Effect,
    Parameter,
    ProbeGroup,
    Scales,
    Scope,
    Shift,
    Values,
    find_actuator,
)

#: Shorter delays and lags are those of stamps and of a controller's own cycle, s.
LEAST_S = 2e-4
#: Longer ones nobody calls delays, s: so much is looked at before and behind what is predicted.
MOST_S = 0.5
#: With which recordings are asked, s.
PROBE_S = 0.004


def late_command(spec: mujoco.MjSpec, joints: Sequence[str], delay_s: float) -> None:
    """Makes the commands of drives late, beside what is late there already."""
    for joint in joints:
        drive = find_actuator(spec, joint)
        total = float(drive.delay) + delay_s
        drive.delay = total
        drive.nsample = max(math.ceil(total / spec.option.timestep - 1e-9) + 1, 1)


class Delay(Effect):
    """Something comes late, on all joints that share the line."""

    needs_drive = True
    scope = Scope.ROBOT
    shares_joints = True
    parameters = (Parameter(name="delay", unit="s", lower=0.0, upper=MOST_S, least=LEAST_S),)

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"delay": PROBE_S}]]


@final
class CommandDelay(Delay):
    """Commands take effect later."""

    name = "command_delay"
    confused_with = ("actuator_lag",)
    shown_by = "fast changes of the command"
    shift = Shift(positions=1.0, efforts=1.0)

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        late_command(spec, joints, values["delay"])

    @override
    def retime(self, time_s: Array, values: Values) -> Array:
        return time_s + values["delay"]


@final
class ServoDelay(Delay):
    """The drive's torque acts later, with all that it depends on: law(u(t-d), q(t-d), v(t-d)).

    Unlike a late command that takes stability from a servo. MuJoCo's `delay` is none of it: that
    reads the command late, and the state at once.
    """

    name = "servo_delay"
    native = False
    costly = True
    confused_with = ("command_delay", "joint_elasticity")
    shown_by = "fast changes of the command that make the servo swing about its target"
    shift = Shift(positions=1.0, efforts=1.0, feedback=True)
    not_stepped = "stepped simulations take its commands late, not what the servo feels"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        late_command(spec, joints, values["delay"])

    @override
    def retime(self, time_s: Array, values: Values) -> Array:
        return time_s + values["delay"]

    @override
    def servo_late_s(self, values: Values) -> float:
        return values["delay"]


@final
class PositionDelay(Delay):
    """Reported positions are those of a moment ago; the servo, inside the robot, has the true ones.

    On the clock of the reports, commands arrive later, and efforts are those of later moments.
    """

    name = "position_delay"
    native = False
    confused_with = ("command_delay", "actuator_lag")
    shown_by = "fast changes of the command, with measured efforts"
    shift = Shift(positions=1.0, efforts=0.0)
    not_stepped = "stepped simulations report positions at once"

    @override
    def retime(self, time_s: Array, values: Values) -> Array:
        return time_s + values["delay"]

    @override
    def effort_apart_s(self, values: Values) -> float:
        return values["delay"]


@final
class EffortDelay(Delay):
    """Reported efforts are those of a moment ago; nothing moves otherwise.

    A torque jumps with the command: efforts beside held commands fit best once in every period.
    """

    name = "effort_delay"
    native = False
    valleys = ("delay",)
    shown_by = "fast changes of the command, with measured efforts"
    shift = Shift(positions=0.0, efforts=1.0)
    not_stepped = "stepped simulations report efforts at once"

    @override
    def effort_apart_s(self, values: Values) -> float:
        return -values["delay"]

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"delay": delay}] for delay in (PROBE_S, 3.0 * PROBE_S, 6.0 * PROBE_S)]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        # Past a period the answer is far from linear: a probe either looks like it or does not.
        return dict(group[0]) if amplitudes[0] > 0.2 else None


@final
class ClockOffset(Delay):
    """Measurements are stamped later than commands by another clock; earlier where it is negative.

    Later it is a command's delay under another name, and looked for as that.
    """

    name = "clock_offset"
    native = False
    parameters = (Parameter(name="offset", unit="s", lower=-MOST_S, upper=MOST_S, least=LEAST_S),)
    shown_by = "fast changes of the command: what answers before it was told"
    shift = Shift(positions=1.0, efforts=1.0)
    not_stepped = "a simulation has one clock"

    @override
    def retime(self, time_s: Array, values: Values) -> Array:
        return time_s + values["offset"]

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"offset": -PROBE_S}]]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        values = super().combine(group, amplitudes)
        return values if values is not None and values["offset"] < 0.0 else None
