"""A bridge with a mirror of the arm, its driver, and a watcher, in one thread."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from gfm.core import Command, CommandKind, ManualClock, Observation
from gfm.live.viewer import Viewer
from gfm.live.watching import KEY, Watching
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.mirror import MirrorRobot
from gfm_robot_bridge.service import BridgeService
from gfm_wire import Message, RecordStart, RecordStop, RobotClock


class Watched:
    """Attributes: watching, that tells viewers when its turn comes; clock; hub."""

    def __init__(
        self, folder: Path, viewers: Sequence[Viewer], joints: tuple[str, ...] = JOINT_NAMES
    ) -> None:
        self.hub, self.clock = MemoryHub(), ManualClock()
        config = BridgeConfig(
            name="bridge", recordings=str(folder), clock=RobotClock.WALL, control_hz=100.0
        )
        transport = MemoryTransport(self.hub, name="bridge", clock=self.clock)
        robot = MirrorRobot(joints)
        self._bridge = BridgeService(config, robot, transport, self.clock)
        self._driver = MemoryTransport(self.hub, name="driver", clock=self.clock)
        watcher = MemoryTransport(self.hub, name="watch", clock=self.clock)
        self.watching = Watching(watcher, viewers, self.clock)
        self._joints = joints

    def ask(self, key: str, message: Message) -> Message:
        pending = self._driver.request(key, message, timeout_s=5.0)
        while (answer := pending.poll()) is None:
            self.pass_time(1)
        return answer

    def pass_time(self, milliseconds: int) -> None:
        for _ in range(milliseconds):
            self.clock.advance_s(1e-3)
            while self._bridge.step():
                pass

    def drive(self, periods: int) -> None:
        """Drives faster and faster, so that no two periods are alike; the bridge clips some."""
        for number in range(periods):
            command = Command(
                kind=CommandKind.VELOCITY,
                joint_names=self._joints,
                values=np.linspace(0.01, 0.1, len(self._joints)) * number,
                stamp_ns=self.clock.utc_ns(),
                number=number,
            )
            self.ask("robot/command", command)

    def published(self) -> Callable[[], list[Observation]]:
        """Returns what tells the first of every stamp that is published from now on."""
        heard = MemoryTransport(self.hub, name="test", clock=self.clock).subscribe(KEY, keep=1000)

        def first() -> list[Observation]:
            by_stamp: dict[int, Observation] = {}
            while (message := heard.take()) is not None:
                if isinstance(message, Observation):
                    by_stamp.setdefault(message.stamp_ns, message)
            return list(by_stamp.values())

        return first

    def record(self, name: str, periods: int) -> None:
        """Drives, recorded."""
        self.ask("robot/record", RecordStart(name=name))
        self.drive(periods)
        self.ask("robot/record", RecordStop())
