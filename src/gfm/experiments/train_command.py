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
    parser.add_argument(
        "--from",
        dest="begin_from",
        type=Path,
        metavar="POLICY",
        help="policy.npz, or the folder of a run, with which it begins (default: a random policy)",
    )
    parser.add_argument("--resume", action="store_true", help="go on with the run in that folder")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Trains."""
    from rich.console import Console

    from gfm.core import ConfigError, MonotonicClock
    from gfm.experiments.evaluate import policy_path
    from gfm.experiments.train import TrainRequest, train
    from gfm.service import StopSignal

    if arguments.resume and arguments.begin_from is not None:
        raise ConfigError("--from and --resume: expected one of them, what is resumed has begun")
    stopped = StopSignal()
    stopped.install()
    config: Path = arguments.config
    request = TrainRequest(
        config=config,
        out=arguments.out or Path("runs") / config.stem,
        resume=arguments.resume,
        begin_from=None if arguments.begin_from is None else policy_path(arguments.begin_from),
    )
    train(request, Console(), MonotonicClock(), stopped)
    return 0
