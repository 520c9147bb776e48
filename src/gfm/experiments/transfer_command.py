"""The command `gfm transfer`: the whole loop on a task."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from gfm.experiments.drive_command import add_robot_flags, request_of
from gfm.experiments.policy_flags import ADAPTED, TREATMENTS

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Closes the loop on a task: runs a policy on the robot and records it, and the arm by itself in the
air, finds what the nominal cell lacks, adapts the policy to the corrected model, and runs it on the
robot again. Every step leaves a folder in --out and is not made a second time: the same command
goes on where it was broken off.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm transfer`."""
    parser = subparsers.add_parser(
        "transfer", help="close the loop on a task", description=_DESCRIPTION
    )
    add_robot_flags(parser)
    parser.add_argument(
        "--minutes",
        type=float,
        default=5.0,
        metavar="N",
        help="for the search of the diagnosis (default: %(default)g)",
    )
    parser.add_argument(
        "--air-seconds",
        type=float,
        default=8.0,
        metavar="N",
        help="length of each motion of the arm by itself, above the basket, that is recorded for "
        "the diagnosis beside the attempts; 0 for none, as in the paper (default: %(default)g)",
    )
    parser.add_argument(
        "--treatments",
        nargs="+",
        choices=TREATMENTS,
        default=[ADAPTED],
        metavar="NAME",
        help="what is done to the policy, one after the other, each from the same beginning: "
        "placed (left as it is, the corrected model says where the tool is), told (the same, and "
        "the robot is told of the payload that was named), adapted to the "
        "corrected model, or trained again on a model, which is corrected, nominal "
        "or randomised (default: adapted)",
    )
    parser.add_argument(
        "--learner-steps",
        type=int,
        metavar="N",
        help="of each training (default: about ten minutes on two cores)",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Closes the loop."""
    from rich.console import Console

    from gfm.core import MonotonicClock
    from gfm.experiments.transfer import TransferRequest, transfer
    from gfm.service import StopSignal

    request = TransferRequest(
        drive=request_of(arguments),
        minutes=arguments.minutes,
        treatments=tuple(arguments.treatments),
        learner_steps=arguments.learner_steps,
        air_s=arguments.air_seconds,
    )
    stopped = StopSignal()
    stopped.install()
    transfer(request, Console(), MonotonicClock(), stopped)
    return 0
