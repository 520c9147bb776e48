"""The command `gfm drive`: a policy on the robot."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gfm.experiments.policy_flags import add_policy_flags
from gfm.launch.flags import add_certs
from gfm.launch.spec import ENGINES

if TYPE_CHECKING:
    from gfm.experiments.drive_request import DriveRequest

    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Runs a policy on the robot, through its bridge, as the paper tests it: ten goals, several attempts
at each, the object put back between them, every attempt recorded. What was done is kept after every
attempt: the same command goes on where it was broken off. The space bar stops the arm until it is
pressed again, q or Ctrl-C ends. The robot is a simulated one that this command starts and that can
hide effects in its arm and in the object, or with --connect one that is there.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm drive`."""
    parser = subparsers.add_parser(
        "drive", help="run a policy on the robot", description=_DESCRIPTION
    )
    parser.add_argument(
        "--model",
        type=Path,
        metavar="FILE",
        help="MJCF of the arm, corrected by a diagnosis, by which the tool is placed (default: the "
        "nominal cell)",
    )
    parser.add_argument(
        "--payload",
        type=float,
        nargs=4,
        metavar=("KG", "X", "Y", "Z"),
        help="tell the robot what it carries, for its gravity compensation: mass, and centre of "
        "mass in the frame of the last link, m (default: nothing)",
    )
    add_robot_flags(parser)
    parser.set_defaults(run=run)


def add_robot_flags(parser: argparse.ArgumentParser) -> None:
    """Adds the flags that say which policy drives which robot, and how often."""
    add_policy_flags(parser)
    parser.add_argument(
        "--robot",
        choices=tuple(ENGINES),
        default="sim",
        help="which simulated one: sim, or the one that Drake moves (default: %(default)s)",
    )
    parser.add_argument(
        "--hidden-effect",
        default="none",
        metavar="NAME",
        help="of the simulated robot: an effect's name, several joined by +, random, or none "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--robot-config",
        type=Path,
        metavar="FILE",
        help="TOML file of settings of the simulated robot: what it hides, with amounts",
    )
    parser.add_argument(
        "--real-time",
        action="store_true",
        help="let the simulated robot's time pass by itself (default: with every command, as fast "
        "as the machine can)",
    )
    parser.add_argument(
        "--connect",
        default="",
        metavar="ENDPOINT",
        help="router of a run with a bridge at 20 Hz, whose robot to drive (default: start one)",
    )
    parser.add_argument(
        "--run", dest="run_name", default="default", help="name of that run (default: %(default)s)"
    )
    add_certs(parser)
    parser.add_argument(
        "--goals", type=int, default=10, metavar="N", help="only the first of them (default: 10)"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="of robot and starts (default: %(default)s)"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where it is kept")


def run(arguments: argparse.Namespace) -> int:
    """Drives."""
    import numpy as np

    from gfm.experiments.drive_policy import drive_policy
    from gfm_wire import SetPayload

    told = arguments.payload
    payload = told and SetPayload(mass_kg=told[0], com_m=np.array(told[1:]))
    drive_policy(replace(request_of(arguments), model=arguments.model, payload=payload))
    return 0


def request_of(arguments: argparse.Namespace) -> DriveRequest:
    """Returns what the flags of `add_robot_flags` ask for."""
    from gfm.experiments.drive_request import DriveRequest

    return DriveRequest(
        task=f"{arguments.task}_matching",
        policy=arguments.policy,
        robot=arguments.robot,
        hidden_effect=arguments.hidden_effect,
        robot_config=arguments.robot_config,
        real_time=arguments.real_time,
        connect=arguments.connect,
        run_name=arguments.run_name,
        certs=arguments.certs,
        goals=arguments.goals,
        trials=arguments.trials,
        seed=arguments.seed,
        out=arguments.out,
    )
