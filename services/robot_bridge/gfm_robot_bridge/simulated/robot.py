"""The simulated robot: an arm with a clock, a command buffer and imperfect sensors.

Time stands still until `advance` is called, and the same calls with the same seed give the same
answers.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from gfm.core import Command, CommandKind, Observation
from gfm.core.checks import Array
from gfm.sim.sawyer import JOINT_NAMES
from gfm_robot_bridge.simulated.arm import Arm
from gfm_robot_bridge.simulated.cell import Cell
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from gfm_robot_bridge.simulated.mechanics import MakeMechanics
from gfm_robot_bridge.simulated.tracker import Tracker, Tracking
from gfm_wire import SetPayload

#: From a command's stamp until it acts. The controller keeps commands until then, so that the
#: network's jitter does not reach the arm; it is part of the robot's description.
COMMAND_LATENCY_NS = 4_000_000
#: As the real arm: without a command for so long, it leaves velocity and torque mode and holds.
COMMAND_TIMEOUT_NS = 200_000_000
#: How it does that, rad/s^2: by seven tenths of what its joints may do, as they pull at each other.
_BRAKING = 0.7 * np.array([10.0, 8.0, 10.0, 10.0, 12.0, 12.0, 12.0])
#: rad/s; slower than that it holds, and after so much time in any case, s: a load makes it sink.
_STILL = 0.01
#: Its brakes stop the arm as fast as its drives can, rad/s^2.
_BRAKES = np.full(len(JOINT_NAMES), 1e4)
_SETTLES_S = 0.2
_STEP_NS = 500_000


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """How well the robot measures itself.

    Attributes:
        period_ns: Between two reports.
        position_noise: Standard deviation, rad.
        velocity_noise: Standard deviation, rad/s.
        effort_noise: Standard deviation, N m.
        encoder_step: Of the position, rad.
    """

    period_ns: int = 10_000_000
    position_noise: float = 1e-4
    velocity_noise: float = 2e-3
    effort_noise: float = 0.05
    encoder_step: float = 2e-5


@final
class SimulatedRobot:
    """A Sawyer arm that starts at rest.

    Args:
        position: Where it starts, rad, shape (J,).
        effects: What it has beyond its nominal model.
        seed: Of the sensors' noise.
        sensors: How well it measures.
        cell: What it has in its hand and in front of it.
        tracking: How well cameras see the object.
        mechanics: The engine that moves it.

    Attributes:
        time_ns: What its clock shows.
        latest: The latest report.
        patience_ns: Without a command for so long it leaves velocity and torque mode.
        is_braked: Whether its brakes are on.
    """

    def __init__(
        self,
        position: Array,
        *,
        effects: Sequence[HiddenEffect] = (),
        seed: int = 0,
        sensors: Sensors | None = None,
        cell: Cell = Cell.NONE,
        tracking: Tracking | None = None,
        mechanics: MakeMechanics = Arm,
    ) -> None:
        self.time_ns = 0
        self.patience_ns = COMMAND_TIMEOUT_NS
        self.is_braked = False
        self._arm = mechanics(position, effects, cell)
        self._tracker = None
        if self._arm.object_pose is not None:
            eyes = np.random.default_rng([seed, 0x0E7E5])
            self._tracker = Tracker(tracking or Tracking(), eyes)
        self._sensors = sensors or Sensors()
        self._rng = np.random.default_rng([seed, 0x0153])
        self._hidden_delay_ns = _delay_ns(effects)
        self._waiting: list[tuple[int, int, Command]] = []
        self._received = 0
        self._commanded_ns = 0
        self._in_force: Command | None = None
        self._stop: tuple[int, Array] | None = None
        self.latest = self._report()
        self._next_report_ns = 0

    def advance(self, command: Command | None, advance_ns: int) -> tuple[Observation, ...]:
        """Takes a command, lets time pass, and returns what the sensors reported meanwhile.

        Args:
            command: Setpoints of all joints, stamped with the robot's time; acts the declared
                latency after its stamp, or at once where that has passed.
            advance_ns: Time to pass.
        """
        if command is not None:
            self.take(command)
        until_ns = self.time_ns + advance_ns
        reports: list[Observation] = []
        while True:
            self._take_due()
            self._look()
            if self._next_report_ns <= self.time_ns:
                self.latest = self._report()
                reports.append(self.latest)
                self._next_report_ns += self._sensors.period_ns
            if self.time_ns >= until_ns:
                return tuple(reports)
            self._step(until_ns)

    def take(self, command: Command) -> None:
        """Keeps a command until it acts, as one of `advance` does; with its brakes on, none."""
        if self.is_braked:
            return
        due_ns = command.stamp_ns + COMMAND_LATENCY_NS + self._hidden_delay_ns
        heapq.heappush(self._waiting, (due_ns, self._received, command))
        self._received += 1

    def brake(self) -> None:
        """Stops the arm at once; it takes no command until `release`."""
        self.is_braked, self._stop = True, None
        self._waiting.clear()
        # Whatever the mode was: a position that it goes to is left, too.
        self._arm.servo.command(CommandKind.VELOCITY, self._arm.velocity, self._arm.position)

    def release(self) -> None:
        """Lets it take commands; until the first it holds where it is."""
        self.is_braked = False

    def _take_due(self) -> None:
        if self.is_braked:
            self._come_to_rest(_BRAKES)
            return
        while self._waiting and self._waiting[0][0] <= self.time_ns:
            _, _, command = heapq.heappop(self._waiting)
            order = [command.joint_names.index(name) for name in JOINT_NAMES]
            self._arm.servo.command(command.kind, command.values[order], self._arm.position)
            self._in_force = command
            self._commanded_ns = self.time_ns
            self._stop = None
        if self.time_ns - self._commanded_ns > self.patience_ns:
            self._come_to_rest(_BRAKING)

    def _come_to_rest(self, braking: Array) -> None:
        """Leaves velocity and torque mode: slows down evenly, then holds where the arm is."""
        arm = self._arm
        if arm.servo.kind is CommandKind.POSITION:
            return
        if self._stop is None:
            self._stop = self.time_ns, arm.velocity
        began_ns, speed = self._stop
        passed_s = (self.time_ns - began_ns) * 1e-9
        left = np.sign(speed) * np.maximum(np.abs(speed) - braking * passed_s, 0.0)
        stood_s = passed_s - float((np.abs(speed) / braking).max())
        moves = (np.abs(arm.velocity) > _STILL).any() and stood_s < _SETTLES_S
        if left.any() or moves:
            arm.servo.command(CommandKind.VELOCITY, left, arm.position)
        else:
            arm.servo.command(CommandKind.POSITION, arm.position, arm.position)

    def _step(self, until_ns: int) -> None:
        """Advances to the next thing that happens, at most by the time step."""
        next_ns = min(until_ns, self.time_ns + _STEP_NS, self._next_report_ns)
        if self._tracker is not None:
            next_ns = min(next_ns, self._tracker.next_ns)
        if self._waiting:
            next_ns = min(next_ns, self._waiting[0][0])
        self._arm.step((next_ns - self.time_ns) * 1e-9)
        self.time_ns = next_ns

    def place_object(self, pose: Array) -> None:
        """Puts the object somewhere, at rest: m and quaternion w x y z, shape (7,).

        Raises:
            RefusedError: there is none.
        """
        self._arm.put_object(pose)

    def carry(self, payload: SetPayload) -> None:
        """Has its gravity compensation bear a load, in place of what it was told before."""
        self._arm.carry(payload)

    def _look(self) -> None:
        """Lets the cameras look where they are due."""
        pose = self._arm.object_pose
        if self._tracker is not None and pose is not None and self._tracker.next_ns <= self.time_ns:
            self._tracker.look(pose)

    def _report(self) -> Observation:
        sensors, arm = self._sensors, self._arm
        noise = self._rng.standard_normal((3, len(JOINT_NAMES)))
        position = arm.position + sensors.position_noise * noise[0]
        tracked = None if self._tracker is None else self._tracker.known(self.time_ns)
        return Observation(
            joint_names=JOINT_NAMES,
            position=np.rint(position / sensors.encoder_step) * sensors.encoder_step,
            velocity=arm.velocity + sensors.velocity_noise * noise[1],
            effort=arm.drive() + sensors.effort_noise * noise[2],
            stamp_ns=self.time_ns,
            applied=self._in_force,
            object_position=None if tracked is None else tracked.pose[:3],
            object_quaternion=None if tracked is None else tracked.pose[3:],
            object_stamp_ns=0 if tracked is None else tracked.stamp_ns,
        )


def _delay_ns(effects: Sequence[HiddenEffect]) -> int:
    seconds = [e.parameters["delay"] for e in effects if e.effect == "command_delay"]
    return round(sum(seconds) * 1e9)
