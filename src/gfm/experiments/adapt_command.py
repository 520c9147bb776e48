"""The flags of `gfm adapt`; what it does is imported when it is done."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gfm.experiments.policy_flags import add_task_flags

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Adapts a policy to a corrected model: it learns to move the arm there as it moved it on the model on
which it was trained. Nothing is rewarded: the inverse dynamics of the corrected model tell what to
command. Takes about two minutes; `gfm train --from` goes on with rewards.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm adapt`."""
    parser = subparsers.add_parser(
        "adapt", help="adapt a policy to a corrected model", description=_DESCRIPTION
    )
    add_task_flags(parser)
    parser.add_argument(
        "--model",
        type=Path,
        required=True,
        metavar="FILE",
        help="MJCF for velocity commands, bare arm or whole cell, with the effects beside it: the "
        "corrected.xml of a diagnosis",
    )
    parser.add_argument(
        "--own",
        type=Path,
        metavar="FILE",
        help="the model on which the policy was trained (default: the nominal cell)",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="the adapted policy (.npz)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of goals and starts (default: 0)")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Adapts."""
    from rich.console import Console

    from gfm.core import MonotonicClock
    from gfm.experiments.adapt import AdaptRequest, adapt_policy
    from gfm.experiments.evaluate import policy_path
    from gfm.policies import shipped_policy
    from gfm.service import StopSignal

    stopped = StopSignal()
    stopped.install()
    task = f"{arguments.task}_matching"
    request = AdaptRequest(
        task=task,
        policy=policy_path(arguments.policy or shipped_policy(task)),
        model=arguments.model,
        own=arguments.own,
        out=arguments.out,
        seed=arguments.seed,
    )
    adapt_policy(request, Console(), MonotonicClock(), stopped)
    return 0
