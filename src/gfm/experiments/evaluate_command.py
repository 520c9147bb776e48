"""The flags of `gfm evaluate`; what it does is imported when it is done."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Tests a policy as the paper does: ten goals around the basket's centre, five attempts at each, all
in simulation. Says how often it succeeds, with a confidence interval, where and why it fails, and
films the best and the worst attempt.
"""
TASKS = ("position", "pose")


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm evaluate`."""
    parser = subparsers.add_parser(
        "evaluate", help="test a policy at ten goals", description=_DESCRIPTION
    )
    parser.add_argument("--task", choices=TASKS, required=True, help="what the policy is for")
    parser.add_argument(
        "--policy",
        type=Path,
        metavar="CHECKPOINT",
        help="policy.npz, or the folder of a training run (default: the one that comes with gfm)",
    )
    parser.add_argument(
        "--model",
        type=Path,
        metavar="FILE",
        help="MJCF for velocity commands, bare arm or whole cell, with the effects beside it "
        "(default: the nominal cell)",
    )
    parser.add_argument(
        "--forces",
        action="append",
        default=[],
        metavar="FILE",
        help="generalized force model on top, a file or the name of one that comes with gfm; of "
        "several, each attempt draws one",
    )
    parser.add_argument(
        "--trials", type=int, default=5, metavar="N", help="attempts per goal (default: 5)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the starts (default: 0)")
    parser.add_argument(
        "--json", action="store_true", help="print the report as JSON instead of a table"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write report and films there (default: nowhere)"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Evaluates."""
    from gfm.experiments.evaluate import EvaluationRequest, evaluate_policy
    from gfm.policies import forces_path

    evaluate_policy(
        EvaluationRequest(
            task=f"{arguments.task}_matching",
            policy=arguments.policy,
            model=arguments.model,
            forces=tuple(forces_path(name) for name in arguments.forces),
            trials=arguments.trials,
            seed=arguments.seed,
            as_json=arguments.json,
            out=arguments.out,
        )
    )
    return 0
