"""The command `gfm-robot-bridge`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from gfm.core import Clock
from gfm.core.extras import needs
from gfm.service import Service, make_parser, service_main
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import Transport
from gfm_robot_bridge.background import AtOnce, Background, InThread
from gfm_robot_bridge.config import BridgeConfig, address
from gfm_robot_bridge.intera.sawyer import InteraSawyer, SawyerSettings
from gfm_robot_bridge.mirror import MirrorRobot
from gfm_robot_bridge.punctual import go_before_others, settle
from gfm_robot_bridge.robot import Robot
from gfm_robot_bridge.sawyer_guard import sawyer_guard
from gfm_robot_bridge.sawyer_load import sawyer_load
from gfm_robot_bridge.service import BridgeService
from gfm_robot_bridge.simulated_sawyer import SimulatedSawyer
from gfm_wire import RobotClock

#: For an answer of the robot; in lockstep it may compute for long.
_LONGEST_WAIT_S = {RobotClock.WALL: 1.0, RobotClock.LOCKSTEP: 10.0}


def build(
    config: BridgeConfig,
    transport: Transport,
    clock: Clock,
    background: Background | None = None,
) -> Service:
    """Returns the service that the settings describe."""
    robot = _robot(config, transport, clock)
    if config.robot == "mirror":
        return BridgeService(config, robot, transport, clock, background)
    guard, observer = sawyer_guard(config, robot), sawyer_load(config)
    return BridgeService(config, robot, transport, clock, background, guard, observer)


def _robot(config: BridgeConfig, transport: Transport, clock: Clock) -> Robot:
    match config.robot:
        case "mirror":
            return MirrorRobot(JOINT_NAMES)
        case "sawyer":
            return _sawyer(config, clock)
        case "sim":
            waits_s = _LONGEST_WAIT_S[config.clock]
            return SimulatedSawyer(
                transport, clock, robot_clock=RobotClock(config.clock), timeout_s=waits_s
            )


def _sawyer(config: BridgeConfig, clock: Clock) -> Robot:
    """Returns a Sawyer that has introduced itself; websockets are loaded for it only."""
    with needs("robot is sawyer, which needs", "websockets", "ros"):
        from gfm_robot_bridge.intera.websocket_link import WebsocketLink
    link = WebsocketLink(*address(config.ros), clock)
    settings = SawyerSettings(
        software=config.robot_software,
        latency_s=config.ros_latency_s,
        speed_ratio=config.velocity_share,
        wait_s=config.wait_s,
    )
    sawyer = InteraSawyer(link, clock, settings)
    try:
        sawyer.meet()
    except BaseException:
        sawyer.close()
        raise
    return sawyer


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the robot bridge until it is told to stop."""
    parser = make_parser(
        "gfm-robot-bridge",
        "Stands between policies and the robot: limits commands, returns observations, records "
        "both. The simulated robot runs beside it: python -m gfm_robot_bridge.simulated",
    )
    group = parser.add_argument_group("robot")
    group.add_argument(
        "--robot",
        choices=("sim", "mirror", "sawyer"),
        help="a simulated Sawyer, a stand-in, or a Sawyer behind a rosbridge (default: sim)",
    )
    group.add_argument("--ros", metavar="HOST:PORT", help="that rosbridge")
    group.add_argument(
        "--clock",
        choices=tuple(RobotClock),
        help="whether robot time passes by itself, or only with commands (default: wall)",
    )
    group.add_argument(
        "--task",
        choices=("none", "position", "pose"),
        help="for which task it has a tool and a basket, as the robot's own (default: none)",
    )
    group.add_argument("--control-hz", type=float, help="commands per second (default: 50)")
    group.add_argument(
        "--realtime",
        action="store_true",
        help="run before whatever is not real-time (Linux; takes the right to)",
    )
    group.add_argument("--recordings", metavar="DIR", help="where to write recordings")
    group.add_argument(
        "--velocity-share", type=float, help="share of the velocity limits to allow (default: 0.5)"
    )
    group.add_argument(
        "--position-margin-rad", type=float, help="distance to the joint limits (default: 0.05)"
    )
    group.add_argument(
        "--joint-zero-rad",
        type=float,
        nargs=len(JOINT_NAMES),
        metavar="RAD",
        help="what the joints report where the published arm is at zero, as a diagnosis named it, "
        "for the distances that are kept (default: 0)",
    )
    return service_main(parser, BridgeConfig, _build_process, argv)


def _build_process(config: BridgeConfig, transport: Transport, clock: Clock) -> Service:
    """Returns the service as it runs in a process: on the wall clock no file delays the robot."""
    if config.clock == RobotClock.LOCKSTEP:
        return build(config, transport, clock, AtOnce())
    service = build(config, transport, clock, InThread())
    settle()
    if config.realtime:
        go_before_others()
    return service


if __name__ == "__main__":
    sys.exit(main())
