"""The flags of `gfm fit`; what it does is imported when it is done."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gfm.experiments.model_flags import GIVEN, MODEL, add_actuators

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Learns generalized forces that, added to the model, make its simulation follow recordings: from
inverse dynamics, then by reinforcement learning through services on this machine. Says what they
are worth on recordings that were held out.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm fit`."""
    parser = subparsers.add_parser(
        "fit", help="learn forces for what a model lacks", description=_DESCRIPTION
    )
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING", help="MCAP files")
    parser.add_argument(
        "--model",
        dest="models",
        action="append",
        required=True,
        type=Path,
        metavar=MODEL,
        help=f"{GIVEN}; once per kind of command, with the effects beside it",
    )
    add_actuators(parser)
    parser.add_argument(
        "--holdout",
        nargs="+",
        default=[],
        type=Path,
        metavar="RECORDING",
        help="what errors are measured on (default: the last recording)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new folder")
    parser.add_argument(
        "--minutes",
        type=float,
        default=4.0,
        help="of reinforcement learning; 0 for the warm start alone (default: %(default)s)",
    )
    parser.add_argument(
        "--from-nothing",
        action="store_true",
        help="begin, as the paper does, with a policy that has learned nothing",
    )
    parser.add_argument(
        "--period-ms",
        type=float,
        default=20.0,
        help="between two decisions about forces (default: %(default)s; the paper: 50)",
    )
    parser.add_argument("--actors", type=int, default=1, metavar="N", help="processes (default: 1)")
    parser.add_argument("--seed", type=int, default=0, help="of everything random (default: 0)")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fits."""
    from rich.console import Console

    from gfm.api.provenance import command_line
    from gfm.core.extras import needs

    with needs("learning needs", "torch", "learn"):
        from gfm.experiments.fit import COLD, WARM
        from gfm.experiments.fit_answer import print_fit
        from gfm.experiments.fit_files import FitRequest, fit_files

    fitted = fit_files(
        FitRequest(
            recordings=tuple(arguments.recordings),
            holdout=tuple(arguments.holdout),
            models=tuple(arguments.models),
            actuators=arguments.actuators,
            out=arguments.out,
            learning_s=60.0 * arguments.minutes,
            began=COLD if arguments.from_nothing else WARM,
            period_s=1e-3 * arguments.period_ms,
            actors=arguments.actors,
            seed=arguments.seed,
            words=command_line(),
        ),
        Console(stderr=True),
    )
    print_fit(fitted, Console())
    return 0
