"""A robot that does at once what it is told: for tests and dry runs of everything around it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np
from typing_extensions import override

from gfm.core import Command, CommandKind, Observation, UnreachableError
from gfm.core.checks import Array
from gfm_robot_bridge.limits import Limits
from gfm_robot_bridge.robot import Robot
from gfm_robot_bridge.sawyer_limits import sawyer_limits
from gfm_robot_bridge.torque import Dynamics


@final
class MirrorRobot(Robot):
    """Jumps to commanded positions, moves at commanded velocities, feels no torque.

    Of several commands in one exchange it follows the last.

    Args:
        joint_names: Of its joints.
        limits: What they may do.
        report_ns: Between two sensor reports.

    Attributes:
        told: Every command that it was told.
        lost: Set to make it unreachable.
        held: Set to keep it from moving.
        broken: Set to the fault that it has, in words.
        time_lead_ns: By how much its clock is ahead of its reports.
    """

    def __init__(
        self,
        joint_names: tuple[str, ...],
        limits: Limits | None = None,
        report_ns: int = 10_000_000,
    ) -> None:
        self.joint_names = joint_names
        self.limits = limits or sawyer_limits()
        self.command_latency_ns = 0
        self.patience_s = 0.2
        self.dynamics = UnitMasses()
        self.told: list[Command] = []
        self.lost = False
        self.held = False
        self.broken = ""
        self.time_lead_ns = 0
        self._report_ns = report_ns
        self._time_ns = 0
        self._position = np.zeros(len(joint_names))
        self._velocity = np.zeros(len(joint_names))
        self._reports: tuple[Observation, ...] = ()

    @override
    def time_ns(self) -> int:
        return self._time_ns + self.time_lead_ns

    @override
    def begin(self, commands: Sequence[Command], advance_ns: int) -> None:
        self.told.extend(commands)
        if commands:
            self._obey(commands[-1])
        reports = [self._advance() for _ in range(advance_ns // self._report_ns)]
        self._reports = tuple(reports) or (self._report(),)

    @override
    def poll(self) -> tuple[Observation, ...] | None:
        if self.lost:
            raise UnreachableError("the mirror robot", 0.0)
        return self._reports

    @override
    def fault(self) -> str:
        return self.broken

    def _obey(self, command: Command) -> None:
        if self.held:
            return
        self._velocity = np.zeros(len(self.joint_names))
        match command.kind:
            case CommandKind.POSITION:
                self._position = command.values.copy()
            case CommandKind.VELOCITY:
                self._velocity = command.values.copy()

    def _advance(self) -> Observation:
        self._time_ns += self._report_ns
        self._position = self._position + self._velocity * self._report_ns * 1e-9
        return self._report()

    def _report(self) -> Observation:
        return Observation(
            joint_names=self.joint_names,
            position=self._position.copy(),
            velocity=self._velocity.copy(),
            effort=np.zeros(len(self.joint_names)),
            stamp_ns=self._time_ns,
        )


@final
class UnitMasses(Dynamics):
    """Joints of 1 kg m^2 each that do not feel one another."""

    @override
    def accelerations(self, position: Array, velocity: Array, torque: Array) -> Array:
        return torque

    @override
    def torques(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        return acceleration
