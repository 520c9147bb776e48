"""The command `gfm`: one line of help per subcommand; each is imported only when it is called."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module

import gfm
from gfm.parser import OneLineParser

_DESCRIPTION = """\
Closes the gap between a MuJoCo model and the robot it stands for: records the robot, finds what the
model gets wrong, names the missing effect and adds it, and learns forces for the rest.
"""
_EPILOG = """\
Start with `gfm run`. Exit status: 0 done, 1 another process did not answer or refused, 2 bad
input (one line says what), 130 interrupted.
"""
_INTERRUPTED = 130


@dataclass(frozen=True, kw_only=True)
class Subcommand:
    """Where a subcommand lives.

    Attributes:
        name: As it is typed.
        module: Has the function that adds its parser.
        adder: That function's name; the parser's default `run` does the work.
        summary: One line for a newcomer.
    """

    name: str
    module: str
    adder: str
    summary: str


SUBCOMMANDS = (
    Subcommand(
        name="run",
        module="gfm.experiments.commands",
        adder="add_run_parser",
        summary="close the whole loop once on this machine",
    ),
    Subcommand(
        name="diagnose",
        module="gfm.experiments.commands",
        adder="add_diagnose_parser",
        summary="find what a model lacks to explain recordings",
    ),
    Subcommand(
        name="fit",
        module="gfm.experiments.fit_command",
        adder="add_parser",
        summary="learn forces for what a model lacks",
    ),
    Subcommand(
        name="excite",
        module="gfm.experiments.excite",
        adder="add_parser",
        summary="propose, or drive, motions that show effects",
    ),
    Subcommand(
        name="record",
        module="gfm.experiments.record",
        adder="add_parser",
        summary="drive the robot along motions and record them",
    ),
    Subcommand(
        name="recording",
        module="gfm.experiments.recording_command",
        adder="add_parser",
        summary="look into recordings, check, cut, export, save",
    ),
    Subcommand(
        name="import",
        module="gfm.experiments.import_command",
        adder="add_parser",
        summary="turn files of other tools into recordings",
    ),
    Subcommand(
        name="track",
        module="gfm.experiments.track_command",
        adder="add_parser",
        summary="follow a tagged object with cameras",
    ),
    Subcommand(
        name="doctor",
        module="gfm.experiments.doctor_command",
        adder="add_parser",
        summary="check a model and recordings before anything runs",
    ),
    Subcommand(
        name="train",
        module="gfm.experiments.train_command",
        adder="add_parser",
        summary="train a policy",
    ),
    Subcommand(
        name="adapt",
        module="gfm.experiments.adapt_command",
        adder="add_parser",
        summary="adapt a policy to a corrected model",
    ),
    Subcommand(
        name="evaluate",
        module="gfm.experiments.evaluate_command",
        adder="add_parser",
        summary="test a policy at ten goals",
    ),
    Subcommand(
        name="drive",
        module="gfm.experiments.drive_command",
        adder="add_parser",
        summary="run a policy on the robot",
    ),
    Subcommand(
        name="transfer",
        module="gfm.experiments.transfer_command",
        adder="add_parser",
        summary="close the loop on a task",
    ),
    Subcommand(
        name="up",
        module="gfm.launch.commands",
        adder="add_up_parser",
        summary="start replay, learner and actors on this machine",
    ),
    Subcommand(
        name="status",
        module="gfm.launch.commands",
        adder="add_status_parser",
        summary="ask a running system how it is",
    ),
    Subcommand(
        name="top",
        module="gfm.launch.top_command",
        adder="add_parser",
        summary="watch a running system, live",
    ),
    Subcommand(
        name="watch",
        module="gfm.experiments.watch_command",
        adder="add_parser",
        summary="show a robot live, in Foxglove or Rerun",
    ),
    Subcommand(
        name="metrics",
        module="gfm.launch.metrics_command",
        adder="add_parser",
        summary="serve a system's numbers: a page, Prometheus",
    ),
    Subcommand(
        name="robot",
        module="gfm.launch.robot_command",
        adder="add_parser",
        summary="stop a running robot, slow it down, enable it",
    ),
    Subcommand(
        name="router",
        module="gfm.launch.commands",
        adder="add_router_parser",
        summary="run a router that services connect to",
    ),
    Subcommand(
        name="certs",
        module="gfm.launch.certs_command",
        adder="add_parser",
        summary="make certificates for a system's processes",
    ),
)


def make_parser(chosen: str = "") -> OneLineParser:
    """Returns the parser of the command line; only the `chosen` subcommand has its flags."""
    parser = OneLineParser("gfm", description=_DESCRIPTION, epilog=_EPILOG)
    version = f"gfm {gfm.__version__}"
    # With its short name it is the longest: help of the longest command stays on its line.
    parser.add_argument("-V", "--version", action="version", version=version)
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for one in SUBCOMMANDS:
        if one.name == chosen:
            getattr(import_module(one.module), one.adder)(subparsers)
        else:
            subparsers.add_parser(one.name, help=one.summary)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command to its exit status."""
    # Here and in the services that a command starts, arrays are small: more threads than one per
    # process only wait for each other, and do so busily. Before anything loads NumPy or torch.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    words = list(sys.argv[1:] if argv is None else argv)
    arguments = make_parser(words[0] if words else "").parse_args(words)

    # Not before: it loads the transport, which `gfm --help` can do without.
    from gfm.service import exit_status

    status = exit_status(lambda: arguments.run(arguments))
    if status == _INTERRUPTED:
        sys.stderr.write("interrupted\n")
    return status


if __name__ == "__main__":
    sys.exit(main())
