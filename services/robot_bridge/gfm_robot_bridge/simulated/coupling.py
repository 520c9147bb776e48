"""What lies between a motor and its link, where that is not rigid."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import final

from typing_extensions import override

from gfm_robot_bridge.simulated.hidden import HiddenEffect

#: Of the flanks that stop free play.
_FLANK_STIFFNESS = 1e5
_FLANK_DAMPING = 130.0


class Coupling(ABC):
    """Transmits torque from the motor side to the link of one joint."""

    def __init__(self, joint: int) -> None:
        self.joint = joint

    @abstractmethod
    def torque(self, twist: float, rate: float) -> float:
        """Returns the torque on the link, N m, for the motor's lead over the link, rad, rad/s."""


@final
class Elastic(Coupling):
    """A spring."""

    def __init__(self, joint: int, stiffness: float) -> None:
        super().__init__(joint)
        self._stiffness = stiffness

    @override
    def torque(self, twist: float, rate: float) -> float:
        return self._stiffness * twist


@final
class Play(Coupling):
    """Free play between two stiff flanks, which push and never pull."""

    def __init__(self, joint: int, gap: float) -> None:
        super().__init__(joint)
        self._half = gap / 2

    @override
    def torque(self, twist: float, rate: float) -> float:
        if twist > self._half:
            push = _FLANK_STIFFNESS * (twist - self._half) + _FLANK_DAMPING * rate
            return max(push, 0.0)
        if twist < -self._half:
            push = _FLANK_STIFFNESS * (twist + self._half) + _FLANK_DAMPING * rate
            return min(push, 0.0)
        return 0.0


def coupling_of(effects: Sequence[HiddenEffect]) -> Coupling | None:
    """Returns the joint's coupling that is not rigid, if there is one."""
    for effect in effects:
        if effect.effect == "joint_elasticity":
            return Elastic(effect.joints[0], effect.parameters["stiffness"])
        if effect.effect == "backlash":
            return Play(effect.joints[0], effect.parameters["gap"])
    return None
