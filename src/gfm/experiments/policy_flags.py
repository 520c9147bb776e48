"""What flags say of a policy: at which task it is tried, how often, and what is done to it."""

from __future__ import annotations

import argparse
from pathlib import Path

TASKS = ("position", "pose")
#: What can be done to a policy: left as it is, with the tool placed by the corrected model; the
#: same with the robot told of its payload; adapted to that model; or trained again on one of three.
TREATMENTS = PLACED, TOLD, ADAPTED, CORRECTED, NOMINAL, RANDOMISED = (
    "placed",
    "told",
    "adapted",
    "corrected",
    "nominal",
    "randomised",
)


def add_task_flags(parser: argparse.ArgumentParser) -> None:
    """Adds `--task` and `--policy`."""
    parser.add_argument("--task", choices=TASKS, required=True, help="what the policy is for")
    parser.add_argument(
        "--policy",
        type=Path,
        metavar="CHECKPOINT",
        help="policy.npz, or the folder of a training run (default: the one that comes with gfm)",
    )


def add_policy_flags(parser: argparse.ArgumentParser) -> None:
    """Adds `--task`, `--policy` and `--trials`."""
    add_task_flags(parser)
    parser.add_argument(
        "--trials", type=int, default=5, metavar="N", help="attempts per goal (default: 5)"
    )
