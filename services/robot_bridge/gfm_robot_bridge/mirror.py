"""A robot that does at once what it is told: for tests and dry runs of everything around it."""

from __future__ import annotations

from typing import final

import numpy as np
from typing_extensions import override

from gfm.core import Command, CommandKind, Observation, UnreachableError
from gfm_robot_bridge.limits import Limits
from gfm_robot_bridge.robot import Robot
from gfm_robot_bridge.simulated_sawyer import sawyer_limits


@final
class MirrorRobot(Robot):
    """Jumps to commanded positions, moves at commanded velocities, feels no torque.

    Args:
        joint_names: Of its joints.
        limits: What they may do.
        report_ns: Between two sensor reports.

    Attributes:
        told: Every command that it was told.
        lost: Set to make it unreachable.
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
        self.told: list[Command] = []
        self.lost = False
        self._report_ns = report_ns
        self._time_ns = 0
        self._position = np.zeros(len(joint_names))
        self._velocity = np.zeros(len(joint_names))
        self._reports: tuple[Observation, ...] = ()

    @override
    def time_ns(self) -> int:
        return self._time_ns

    @override
    def begin(self, command: Command | None, advance_ns: int) -> None:
        if command is not None:
            self._obey(command)
        count = max(advance_ns // self._report_ns, 1)
        self._reports = tuple(self._advance() for _ in range(count))

    @override
    def poll(self) -> tuple[Observation, ...] | None:
        if self.lost:
            raise UnreachableError("the mirror robot", 0.0)
        return self._reports

    def _obey(self, command: Command) -> None:
        self.told.append(command)
        self._velocity = np.zeros(len(self.joint_names))
        match command.kind:
            case CommandKind.POSITION:
                self._position = command.values.copy()
            case CommandKind.VELOCITY:
                self._velocity = command.values.copy()

    def _advance(self) -> Observation:
        self._time_ns += self._report_ns
        self._position = self._position + self._velocity * self._report_ns * 1e-9
        return Observation(
            joint_names=self.joint_names,
            position=self._position.copy(),
            velocity=self._velocity.copy(),
            effort=np.zeros(len(self.joint_names)),
            stamp_ns=self._time_ns,
        )
