"""Effects that the vocabulary has no name for. One object acts on one joint of one robot."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Callable, Mapping
from typing import final

from typing_extensions import override

#: A payload that moves within the gripper; unlike the others it changes masses.
SLIPPING = "slipping_payload"


class Outside(ABC):  # noqa: B024
    """A law; each of its methods is nothing by default. Time is from the recording's start."""

    def torque(self, time_s: float, q: float, v: float) -> float:
        """Returns a torque on the joint, N m."""
        del time_s, q, v
        return 0.0

    def level(self, q: float, v: float) -> float:
        """Returns dry friction to add, N m."""
        del q, v
        return 0.0

    def drive(self, time_s: float, torque: float, v: float) -> float:
        """Returns what the drive makes of the torque it should give, N m."""
        del time_s, v
        return torque

    def command(self, value: float) -> float:
        """Returns what the drive makes of a command."""
        return value

    def pass_time(self, elapsed_s: float, v: float) -> None:
        """Lets inner states follow."""
        del elapsed_s, v


@final
class CubicSpring(Outside):
    """-stiffness (q - rest)^3."""

    def __init__(self, stiffness: float, rest: float) -> None:
        self._stiffness, self._rest = stiffness, rest

    @override
    def torque(self, time_s: float, q: float, v: float) -> float:
        return -self._stiffness * (q - self._rest) ** 3


@final
class HystereticSpring(Outside):
    """A spring whose yielding part lags behind (Bouc-Wen with n = 1)."""

    def __init__(self, torque: float, yields_at: float) -> None:
        self._torque, self._yields_at, self._strain = torque, yields_at, 0.0

    @override
    def torque(self, time_s: float, q: float, v: float) -> float:
        return -self._torque * self._strain

    @override
    def pass_time(self, elapsed_s: float, v: float) -> None:
        turned = v * elapsed_s / self._yields_at
        strain = self._strain + turned - 0.5 * (abs(turned) * self._strain)
        self._strain = strain - 0.5 * turned * abs(self._strain)


@final
class CableStop(Outside):
    """A cable that is slack up to an angle and pulls beyond it."""

    def __init__(self, stiffness: float, taut_at: float) -> None:
        self._stiffness, self._taut_at = stiffness, taut_at

    @override
    def torque(self, time_s: float, q: float, v: float) -> float:
        return -self._stiffness * max(q - self._taut_at, 0.0)


@final
class TorqueRipple(Outside):
    """A torque that oscillates in time, whatever the joint does: a fan, a pump."""

    def __init__(self, amplitude: float, frequency_hz: float) -> None:
        self._amplitude, self._frequency_hz = amplitude, frequency_hz

    @override
    def torque(self, time_s: float, q: float, v: float) -> float:
        return self._amplitude * math.sin(2.0 * math.pi * self._frequency_hz * time_s)


@final
class Tap(Outside):
    """Someone touches the robot, once: half a sine of torque."""

    def __init__(self, torque: float, at_s: float, for_s: float) -> None:
        self._torque, self._at_s, self._for_s = torque, at_s, for_s

    @override
    def torque(self, time_s: float, q: float, v: float) -> float:
        through = (time_s - self._at_s) / self._for_s
        return self._torque * math.sin(math.pi * through) if 0.0 < through < 1.0 else 0.0


@final
class PositionFriction(Outside):
    """Dry friction that changes along the way: a bent shaft."""

    def __init__(self, torque: float, order: float) -> None:
        self._torque, self._order = torque, order

    @override
    def level(self, q: float, v: float) -> float:
        return self._torque * (1.0 + 0.95 * math.sin(self._order * q))


@final
class RootFriction(Outside):
    """Friction that grows with the root of the speed: mixed lubrication."""

    def __init__(self, coefficient: float) -> None:
        self._coefficient = coefficient

    @override
    def level(self, q: float, v: float) -> float:
        return self._coefficient * math.sqrt(abs(v))


@final
class FadingDrive(Outside):
    """A drive that loses torque as it warms up."""

    def __init__(self, loss: float, time_s: float) -> None:
        self._loss, self._time_s = loss, time_s

    @override
    def drive(self, time_s: float, torque: float, v: float) -> float:
        warm = 1.0 - math.exp(-max(time_s, 0.0) / self._time_s)
        return torque * (1.0 - self._loss * warm)


@final
class VoltageLimit(Outside):
    """A motor whose largest torque falls with the speed at which it drives."""

    def __init__(self, stall: float, fastest: float) -> None:
        self._stall, self._fastest = stall, fastest

    @override
    def drive(self, time_s: float, torque: float, v: float) -> float:
        with_motion = max(math.copysign(v, torque * v), 0.0) / self._fastest
        most = self._stall * max(1.0 - with_motion, 0.0)
        return math.copysign(min(abs(torque), most), torque)


@final
class CommandSteps(Outside):
    """A line that rounds commands."""

    def __init__(self, step: float) -> None:
        self._step = step

    @override
    def command(self, value: float) -> float:
        return self._step * round(value / self._step)


@final
class FadingFriction(Outside):
    """Viscous friction of grease that warms up."""

    def __init__(self, coefficient: float, time_s: float) -> None:
        self._coefficient, self._time_s = coefficient, time_s

    @override
    def torque(self, time_s: float, q: float, v: float) -> float:
        cold = math.exp(-max(time_s, 0.0) / self._time_s)
        return -self._coefficient * (0.2 + 0.8 * cold) * v


@final
class Detent(Outside):
    """A magnet that pulls a joint into one angle, from nearby only."""

    def __init__(self, torque: float, at: float, width: float) -> None:
        self._torque, self._at, self._width = torque, at, width

    @override
    def torque(self, time_s: float, q: float, v: float) -> float:
        away = (q - self._at) / self._width
        return -self._torque * away * math.exp(0.5 - 0.5 * away**2)


@final
class Wind(Outside):
    """Drag of air that moves."""

    def __init__(self, coefficient: float, speed: float) -> None:
        self._coefficient, self._speed = coefficient, speed

    @override
    def torque(self, time_s: float, q: float, v: float) -> float:
        through = v - self._speed
        return -self._coefficient * through * abs(through)


@final
class SoftDrive(Outside):
    """A motor whose iron saturates: it gives less the more it should give."""

    def __init__(self, torque: float) -> None:
        self._torque = torque

    @override
    def drive(self, time_s: float, torque: float, v: float) -> float:
        return torque / math.hypot(1.0, torque / self._torque)


@final
class UnevenDrive(Outside):
    """A drive that is stronger one way than the other."""

    def __init__(self, difference: float) -> None:
        self._difference = difference

    @override
    def drive(self, time_s: float, torque: float, v: float) -> float:
        return torque + 0.5 * self._difference * abs(torque)


#: Laws that were there while the search was built.
STRANGE: Mapping[str, Callable[..., Outside]] = {
    "cubic_spring": CubicSpring,
    "hysteretic_spring": HystereticSpring,
    "cable_stop": CableStop,
    "torque_ripple": TorqueRipple,
    "tap": Tap,
    "position_friction": PositionFriction,
    "root_friction": RootFriction,
    "fading_drive": FadingDrive,
    "voltage_limit": VoltageLimit,
    "command_steps": CommandSteps,
}

#: Laws that came when it was.
UNFORESEEN: Mapping[str, Callable[..., Outside]] = {
    "fading_friction": FadingFriction,
    "detent": Detent,
    "wind": Wind,
    "soft_drive": SoftDrive,
    "uneven_drive": UnevenDrive,
}


def outside(effect: str, parameters: Mapping[str, float]) -> Outside:
    """Returns a fresh law."""
    return {**STRANGE, **UNFORESEEN}[effect](**parameters)


def is_strange(effect: str) -> bool:
    """Returns whether an effect is one that the vocabulary has no name for."""
    return effect == SLIPPING or effect in STRANGE or effect in UNFORESEEN
