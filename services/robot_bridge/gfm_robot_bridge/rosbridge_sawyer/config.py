"""What the simulated Sawyer behind a rosbridge may be told."""

from __future__ import annotations

from gfm.core import ConfigError
from gfm.transport import is_loopback
from gfm_robot_bridge.config import address
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_wire import RobotClock


class RosbridgeConfig(SimulatedConfig, frozen=True, kw_only=True):
    """Settings of the simulated robot, and of the line to it.

    Attributes:
        ros: HOST:PORT to listen on.
        latency_s: That every message is late, in each direction.
        jitter_s: By how much more at most, evenly distributed; messages stay in order.
        loss: Which part of the published messages is lost, in each direction.
        clock_ahead_s: By how much its clock is ahead of this machine's.
        software: Version that it says it has.
    """

    ros: str = "127.0.0.1:9090"
    latency_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    clock_ahead_s: float = 0.0
    software: str = "5.3.0.0"

    def __post_init__(self) -> None:
        super().__post_init__()
        host, _ = address(self.ros)
        if not self.insecure and not is_loopback(host):
            raise ConfigError(
                f"ros is {self.ros}, where anybody on the network may drive: expected an address "
                "of this machine alone (127.0.0.1), or --insecure where that is meant"
            )
        if self.clock != RobotClock.WALL:
            raise ConfigError(f"clock is {self.clock}, expected wall: ROS has no other")
        if self.task != "none":
            raise ConfigError(f"task is {self.task}, expected none: no camera of it is on a topic")
        for name, most in (("latency_s", 10.0), ("jitter_s", 10.0), ("loss", 1.0)):
            if not 0.0 <= (value := getattr(self, name)) <= most:
                raise ConfigError(f"{name} is {value}, expected 0 to {most:g}")
