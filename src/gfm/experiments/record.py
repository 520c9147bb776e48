"""The command `gfm record`."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from gfm.core import ConfigError, MonotonicClock
from gfm.excitation.motion import Motion, Purpose
from gfm.excitation.waypoints import motions
from gfm.experiments.drive import drive, sawyer_ranges
from gfm.launch.flags import add_endpoint, address_of
from gfm_wire import Role

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Drives the robot of a running system along motions that show what its model lacks, and has them
recorded by its bridge. Needs gfm-robot-bridge and, unless the robot is real, the simulated robot.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm record`."""
    parser = subparsers.add_parser(
        "record", help="drive the robot along motions and record them", description=_DESCRIPTION
    )
    add_endpoint(parser, "--connect", "the system's router")
    parser.add_argument("--seed", type=int, default=0, help="of the motions (default: %(default)s)")
    parser.add_argument(
        "--duration-s", type=float, default=12.0, help="of each motion (default: %(default)s)"
    )
    parser.add_argument(
        "--control-hz",
        type=float,
        default=50.0,
        help="commands per second, as the bridge's (default: %(default)s)",
    )
    parser.add_argument(
        "--only", choices=[str(purpose) for purpose in Purpose], help="leave the others out"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Drives and records; says where each recording is."""
    chosen = chosen_motions(arguments)
    clock = MonotonicClock()
    with address_of(arguments).open(Role.DRIVER, name="record") as transport:
        for driven in drive(transport, clock, chosen):
            sys.stdout.write(f"{driven.path}: {driven.reports} measurements\n")
            sys.stdout.flush()
    return 0


def chosen_motions(arguments: argparse.Namespace) -> list[Motion]:
    """Returns the motions that the command line asks for."""
    if not 4.0 <= arguments.duration_s <= 600.0:
        raise ConfigError(f"--duration-s is {arguments.duration_s}, expected 4 to 600")
    if not 10.0 <= arguments.control_hz <= 200.0:
        raise ConfigError(f"--control-hz is {arguments.control_hz}, expected 10 to 200")
    made = motions(
        sawyer_ranges(),
        seed=arguments.seed,
        period_s=1.0 / arguments.control_hz,
        duration_s=arguments.duration_s,
    )
    return [motion for motion in made if arguments.only in (None, motion.purpose)]
