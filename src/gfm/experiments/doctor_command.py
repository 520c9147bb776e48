"""The command `gfm doctor`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from gfm.experiments.model_flags import GIVEN, MODEL, add_actuators, add_topics

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Checks a model and recordings against each other before anything runs: joint names, units, kinds of
command, rates, gaps and clocks, ranges, what the motions can show and what not, and how long a
diagnosis would take. One line a check: ok, warn (a diagnosis goes on), refuse (it would not), each
with what to do.
"""
_EPILOG = "Exit status: 0 a diagnosis can begin, 2 something is refused."


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm doctor`."""
    parser = subparsers.add_parser(
        "doctor",
        help="check a model and recordings before anything runs",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument("model", type=Path, metavar=MODEL, help=GIVEN)
    parser.add_argument(
        "recordings", nargs="+", type=Path, metavar="RECORDING", help="MCAP file, or a folder"
    )
    parser.add_argument(
        "--model",
        dest="more",
        action="append",
        default=[],
        type=Path,
        metavar=MODEL,
        help="one more, for another kind of command",
    )
    add_actuators(parser)
    parser.add_argument(
        "--holdout",
        nargs="+",
        action="extend",
        type=Path,
        default=[],
        metavar="RECORDING",
        help="what errors would be measured on",
    )
    add_topics(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Examines and prints; the status says whether a diagnosis would begin."""
    from gfm.api.doctor.examine import doctor

    found = doctor(
        [arguments.model, *arguments.more],
        arguments.recordings,
        actuators=arguments.actuators,
        holdout=arguments.holdout,
        joint_states=arguments.joint_states,
        command=arguments.command,
    )
    if arguments.json:
        sys.stdout.write(json.dumps(found.document(), indent=2, ensure_ascii=False) + "\n")
    else:
        found.print(Console())
    return 0 if found.ok else 2
