"""Runs `gfm drive` or `gfm transfer` with the simulated robot and its bridge in the same process.

    python benchmarks/one_process.py transfer --task position --robot-config FILE --out DIR

Robot, bridge and driver are the same services in lockstep, over the transport in memory: attempts
are the same to the last bit, and nobody is given up because a busy machine kept it waiting.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from unittest.mock import patch

from gfm.cli import main as gfm
from gfm.core import Clock, ConfigError
from gfm.core.checks import Array
from gfm.envs.arm import CONTROL_PERIOD_S
from gfm.experiments import drive_policy
from gfm.experiments.drive_request import DriveRequest
from gfm.launch.spec import ENGINES
from gfm.service.config import read_config
from gfm.transport import MemoryHub, MemoryTransport, Transport
from gfm_robot_bridge.__main__ import build as build_bridge
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.simulated.__main__ import build as build_robot
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_wire import RobotClock


@contextmanager
def robot_of(
    request: DriveRequest, clock: Clock, zero: Array
) -> Iterator[tuple[Transport, Callable[[], None]]]:
    """Yields a connection to the robot that is asked for, and what lets it go on.

    Raises:
        ConfigError: time would have to pass by itself.
    """
    if request.connect or request.real_time:
        raise ConfigError("--connect or --real-time: expected none of them in one process")
    hub = MemoryHub()

    def transport(name: str) -> MemoryTransport:
        return MemoryTransport(hub, name=name, clock=clock)

    bridge = build_bridge(_bridge(request, zero), transport("robot-bridge"), clock)
    robot = build_robot(_robot(request), transport("robot"), clock)

    def both() -> None:
        bridge.step()
        robot.step()

    try:
        yield transport("drive"), both
    finally:
        bridge.close()
        robot.close()


def _bridge(request: DriveRequest, zero: Array) -> BridgeConfig:
    settings = {
        **_both(request),
        "name": "robot-bridge",
        "recordings": str(request.out.absolute() / "recordings"),
        "control_hz": 1.0 / CONTROL_PERIOD_S,
        "joint_zero_rad": tuple(zero.tolist()),
    }
    return read_config(BridgeConfig, None, settings)


def _robot(request: DriveRequest) -> SimulatedConfig:
    request.out.mkdir(parents=True, exist_ok=True)
    settings = {
        **_both(request),
        "name": "robot",
        "engine": ENGINES[request.robot],
        "hidden_effect": request.hidden_effect,
        "seed": request.seed,
        "sealed": str(request.out.absolute() / "sealed.json"),
    }
    return read_config(SimulatedConfig, request.robot_config, settings)


def _both(request: DriveRequest) -> dict[str, str]:
    return {"clock": RobotClock.LOCKSTEP.value, "task": request.task.removesuffix("_matching")}


def main() -> int:
    """Runs the command; returns its exit status."""
    with patch.object(drive_policy, "robot_of", robot_of):
        return gfm(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
