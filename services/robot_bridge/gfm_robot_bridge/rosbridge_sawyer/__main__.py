"""The process of a Sawyer behind a rosbridge: `python -m gfm_robot_bridge.rosbridge_sawyer`."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence

import msgspec

from gfm.core import MonotonicClock
from gfm.core.extras import needs
from gfm.service import StopSignal, exit_status, make_parser, run_service, start_logging
from gfm.service.command import parse_config
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.config import address
from gfm_robot_bridge.rosbridge_sawyer.config import RosbridgeConfig
from gfm_robot_bridge.rosbridge_sawyer.door import Door
from gfm_robot_bridge.rosbridge_sawyer.service import RosbridgeService
from gfm_robot_bridge.simulated.__main__ import add_robot_flags, build_robot

_log = logging.getLogger(__name__)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the robot until it is told to stop; like a real one it is no part of a run."""
    parser = make_parser(
        "gfm-rosbridge-sawyer",
        "A Sawyer arm in simulation, behind Intera's topics and a rosbridge, for "
        "`gfm-robot-bridge --robot sawyer`. It is switched off at first: gfm robot enable.",
        joins=False,
    )
    group = add_robot_flags(parser)
    group.add_argument("--software", metavar="VERSION", help="that it says it has")
    group.add_argument("--clock-ahead-s", type=float, metavar="S", help="of its clock (default: 0)")
    group = parser.add_argument_group("line")
    group.add_argument(
        "--ros", metavar="HOST:PORT", help="where to listen (default: 127.0.0.1:9090)"
    )
    group.add_argument(
        "--insecure",
        action="store_true",
        default=argparse.SUPPRESS,
        help="listen beyond this machine: anybody there may drive it, a rosbridge asks nobody",
    )
    group.add_argument("--latency-s", type=float, metavar="S", help="of messages, each way")
    group.add_argument("--jitter-s", type=float, metavar="S", help="beyond that, at most")
    group.add_argument("--loss", type=float, metavar="PART", help="of messages, each way")

    def run() -> None:
        config = parse_config(parser, RosbridgeConfig, argv)
        start_logging(config.log_level)
        _log.info("settings: %s", msgspec.json.encode(config).decode())
        clock = MonotonicClock()
        stopped = StopSignal()
        stopped.install()
        robot = build_robot(config)
        service = RosbridgeService(config, robot, _door(config.ros), clock)
        _log.info("listening on %s", config.ros)
        run_service(service, MemoryTransport(MemoryHub(), clock=clock), clock, stopped)
        _log.info("stopped")

    return exit_status(run)


def _door(ros: str) -> Door:
    with needs("a rosbridge needs", "websockets", "ros"):
        from gfm_robot_bridge.rosbridge_sawyer.websocket_door import WebsocketDoor
    return WebsocketDoor(*address(ros))


if __name__ == "__main__":
    sys.exit(main())
