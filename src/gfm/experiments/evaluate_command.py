"""The flags of `gfm evaluate`; what it does is imported when it is done."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gfm.experiments.policy_flags import add_policy_flags

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Tests a policy as the paper does: ten goals around the basket's centre, five attempts at each, all
in simulation. Says how often it succeeds, with a confidence interval, where and why it fails, and
films the best and the worst attempt.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm evaluate`."""
    parser = subparsers.add_parser(
        "evaluate", help="test a policy at ten goals", description=_DESCRIPTION
    )
    add_policy_flags(parser)
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
        "--sensed",
        action="store_true",
        help="let the policy see what a robot's sensors tell, late and with noise",
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
            sensed=arguments.sensed,
            trials=arguments.trials,
            seed=arguments.seed,
            as_json=arguments.json,
            out=arguments.out,
        )
    )
    return 0
