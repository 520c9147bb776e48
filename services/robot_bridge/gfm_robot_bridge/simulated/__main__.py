"""The simulated Sawyer's process: `python -m gfm_robot_bridge.simulated`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from gfm.core import Clock
from gfm.core.extras import needs
from gfm.service import Service, make_parser, service_main
from gfm.sim.sawyer import READY
from gfm.transport import Transport
from gfm_robot_bridge.simulated.arm import Arm
from gfm_robot_bridge.simulated.cell import Cell
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.hidden import draw, given, names, object_names
from gfm_robot_bridge.simulated.mechanics import MakeMechanics
from gfm_robot_bridge.simulated.robot import Sensors, SimulatedRobot
from gfm_robot_bridge.simulated.sealed import seal
from gfm_robot_bridge.simulated.service import SimulatedService
from gfm_wire import RobotClock


def build(config: SimulatedConfig, transport: Transport, clock: Clock) -> Service:
    """Returns the service that the settings describe; what it hides is sealed before it answers."""
    return SimulatedService(config, build_robot(config), transport, clock)


def build_robot(config: SimulatedConfig) -> SimulatedRobot:
    """Returns the robot that the settings describe, at rest; what it hides is sealed."""
    effects = given(config.hidden) or draw(config.hidden_effect, config.seed, READY)
    sensors = Sensors(period_ns=round(config.period_s * 1e9))
    robot = SimulatedRobot(
        READY,
        effects=effects,
        seed=config.seed,
        sensors=sensors,
        cell=Cell(config.task),
        mechanics=_engine(config.engine),
    )
    if config.sealed_path is not None:
        seal(config.sealed_path, effects, choice=config.choice, seed=config.seed)
    return robot


def _engine(name: str) -> MakeMechanics:
    """Returns what moves the robot; Drake is loaded where it is asked for only."""
    if name == "mujoco":
        return Arm
    with needs("engine is drake, which needs", "pydrake", "drake"):
        from gfm_robot_bridge.simulated.drake_arm import DrakeArm
    return DrakeArm


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the simulated robot until it is told to stop."""
    parser = make_parser(
        "gfm-simulated-sawyer",
        "A Sawyer arm in simulation, behind the protocol by which the robot bridge drives it. "
        "It can hide an effect that its nominal model does not declare.",
    )
    group = add_robot_flags(parser)
    group.add_argument("--clock", choices=tuple(RobotClock), help="(default: wall)")
    group.add_argument(
        "--task", choices=("none", "position", "pose"), help="for which the cell is furnished"
    )
    return service_main(parser, SimulatedConfig, build, argv)


def add_robot_flags(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Adds and returns the flags that say what a simulated robot is."""
    group = parser.add_argument_group("robot")
    group.add_argument(
        "--engine", choices=("mujoco", "drake"), help="what moves it (default: mujoco)"
    )
    group.add_argument(
        "--hidden-effect",
        metavar="NAME",
        help="random, none (the default), or some of these joined by +: "
        f"{', '.join((*names(), *object_names()))}",
    )
    group.add_argument("--seed", type=int, help="of the hidden effect and of the noise")
    group.add_argument("--sealed", metavar="FILE", help="where to write what is hidden")
    group.add_argument("--period-s", type=float, help="between sensor reports (default: 0.01)")
    return group


if __name__ == "__main__":
    sys.exit(main())
