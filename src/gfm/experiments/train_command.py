"""The flags of `gfm train`; what it does is imported when it is done."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Trains a policy as a file says (see configs/): replay, learner and actors as processes of this
machine, checkpoints and curves in one folder. Ctrl-C stops it in order; --resume goes on.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm train`."""
    parser = subparsers.add_parser("train", help="train a policy", description=_DESCRIPTION)
    parser.add_argument(
        "--config", type=Path, required=True, metavar="FILE", help="TOML file of the experiment"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="the run's folder (default: runs/ and FILE's name)"
    )
    parser.add_argument("--resume", action="store_true", help="go on with the run in that folder")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Trains."""
    from rich.console import Console

    from gfm.core import MonotonicClock
    from gfm.experiments.train import TrainRequest, train
    from gfm.service import StopSignal

    stopped = StopSignal()
    stopped.install()
    config: Path = arguments.config
    request = TrainRequest(
        config=config,
        out=arguments.out or Path("runs") / config.stem,
        resume=arguments.resume,
    )
    train(request, Console(), MonotonicClock(), stopped)
    return 0
