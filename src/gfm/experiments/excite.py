"""The flags of `gfm excite`; what it does is imported when it is done."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from gfm.core import CommandKind, ConfigError
from gfm.experiments.model_flags import GIVEN, MODEL, add_actuators
from gfm.launch.address import RunAddress
from gfm.launch.flags import add_certs
from gfm.launch.own_certs import certs_to_join

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Proposes motions that make effects nameable which a model may lack: rests, slow reversals, sweeps,
multisines, steps and bursts, within the joints' ranges and limits, touching nothing, by the model.
With --connect they are driven through the robot bridge and recorded; without, they are written as
tables of commands, with a page that shows them. Nothing moves without --connect.
"""
_EPILOG = """\
Start with --list: it says which motion shows which effect. docs/excitation.md describes the files.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm excite`."""
    parser = subparsers.add_parser(
        "excite",
        help="propose, or drive, motions that show effects",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "--model",
        dest="models",
        action="append",
        default=[],
        type=Path,
        metavar=MODEL,
        help=f"{GIVEN}, with its surroundings; once per kind of command",
    )
    add_actuators(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="for the plan")
    parser.add_argument(
        "--list", action="store_true", help="say which motion shows which effect, and end"
    )
    _add_choice(parser)
    _add_limits(parser)
    _add_robot(parser)
    parser.set_defaults(run=run)


def _add_choice(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("which motions")
    group.add_argument(
        "--for",
        dest="effects",
        nargs="+",
        action="extend",
        default=[],
        metavar="EFFECT",
        help="those that show these effects (default: all)",
    )
    group.add_argument(
        "--report",
        type=Path,
        metavar="report.json",
        help="those that the open questions of this diagnosis ask for",
    )
    group.add_argument(
        "--command",
        action="append",
        default=[],
        choices=[str(kind) for kind in CommandKind],
        help="how they are commanded (default: as the models' actuators)",
    )
    group.add_argument(
        "--joint",
        dest="joints",
        nargs="+",
        action="extend",
        default=[],
        metavar="JOINT",
        help="the joints that move (default: all)",
    )
    group.add_argument(
        "--seconds",
        type=float,
        default=20.0,
        metavar="N",
        help="length of each (default: %(default)s)",
    )
    group.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="of postures, orders and phases; names the recordings too (default: %(default)s)",
    )


def _add_limits(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("limits, where the model says nothing or too much")
    group.add_argument(
        "--pose", metavar="KEYFRAME", help="where they begin (default: the first, or zero)"
    )
    group.add_argument(
        "--range",
        dest="ranges",
        action="append",
        default=[],
        metavar="JOINT=LO:HI",
        help="positions, rad",
    )
    for name, unit in (("velocity", "rad/s"), ("acceleration", "rad/s^2")):
        group.add_argument(
            f"--max-{name}",
            action="append",
            default=[],
            metavar="[JOINT=]VALUE",
            help=f"{unit}, of one joint or of all",
        )
    group.add_argument(
        "--clearance",
        type=float,
        default=0.01,
        metavar="METRES",
        help="distance to keep from everything (default: %(default)s)",
    )


def _add_robot(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("the robot")
    group.add_argument(
        "--connect",
        metavar="ENDPOINT",
        help="drive the robot whose bridge is there, and record it",
    )
    group.add_argument(
        "--run",
        dest="run_name",
        default="default",
        metavar="NAME",
        help="name of the bridge's run (default: %(default)s)",
    )
    add_certs(group)
    group.add_argument(
        "--control-hz",
        type=float,
        default=50.0,
        metavar="HZ",
        help="commands per second, as the bridge's (default: %(default)s)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Proposes motions, and drives them where that is asked for."""
    if arguments.list:
        from gfm.experiments.excite_command import print_families

        print_families(Console())
        return 0
    if not arguments.models or arguments.out is None:
        raise ConfigError("expected --model and --out (or --list)")
    if not 10.0 <= arguments.control_hz <= 500.0:
        raise ConfigError(f"--control-hz is {arguments.control_hz:g}, expected 10 to 500")
    if not 0.0 <= arguments.clearance <= 1.0:
        raise ConfigError(f"--clearance is {arguments.clearance:g}, expected 0 to 1")

    from gfm.excitation.limits import Wishes
    from gfm.experiments.excite_command import ExciteRequest, excite

    request = ExciteRequest(
        models=tuple(arguments.models),
        out=arguments.out,
        effects=tuple(arguments.effects),
        report=arguments.report,
        kinds=tuple(CommandKind(one) for one in dict.fromkeys(arguments.command)),
        seconds=arguments.seconds,
        seed=arguments.seed,
        period_s=1.0 / arguments.control_hz,
        clearance_m=arguments.clearance,
        wishes=Wishes(
            pose=arguments.pose,
            joints=tuple(dict.fromkeys(arguments.joints)),
            ranges=joint_ranges(arguments.ranges),
            speed=joint_values("--max-velocity", arguments.max_velocity),
            acceleration=joint_values("--max-acceleration", arguments.max_acceleration),
        ),
        robot=_address(arguments),
        actuators=arguments.actuators,
    )
    excite(request, Console(), Console(file=sys.stderr))
    return 0


def _address(arguments: argparse.Namespace) -> RunAddress | None:
    if not arguments.connect:
        return None
    certs = certs_to_join(arguments.connect, arguments.certs)
    return RunAddress(run=arguments.run_name, endpoint=arguments.connect, certs=certs)


def joint_values(flag: str, words: Sequence[str]) -> dict[str, float]:
    """Returns the value by joint of words like "elbow=0.5"; of "0.5" for all, under ""."""
    values: dict[str, float] = {}
    for word in words:
        joint, _, text = word.rpartition("=")
        values[joint] = _number(text)
        if not 0.0 < values[joint] < math.inf:
            raise ConfigError(f"{flag} {word}: expected [JOINT=]VALUE, a number above 0")
    return values


def joint_ranges(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Returns the lowest and the highest position by joint, of words like "elbow=-1:0.5"."""
    ranges = {}
    for word in words:
        joint, _, text = word.rpartition("=")
        lower, _, upper = (_number(part) if part != ":" else 0.0 for part in text.partition(":"))
        if not (joint and math.isfinite(upper - lower) and lower < upper):
            raise ConfigError(f"--range {word}: expected JOINT=LOW:HIGH, rad, low below high")
        ranges[joint] = (lower, upper)
    return ranges


def _number(text: str) -> float:
    """Returns the number, or NaN for what is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan
