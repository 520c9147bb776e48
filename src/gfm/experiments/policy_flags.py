"""What flags say of a policy: at which task it is tried, how often, and what it is trained on."""

from __future__ import annotations

import argparse
from pathlib import Path

TASKS = ("position", "pose")
#: What a policy can be trained on again.
TRAIN_ON = CORRECTED, NOMINAL, RANDOMISED = ("corrected", "nominal", "randomised")


def add_policy_flags(parser: argparse.ArgumentParser) -> None:
    """Adds `--task`, `--policy` and `--trials`."""
    parser.add_argument("--task", choices=TASKS, required=True, help="what the policy is for")
    parser.add_argument(
        "--policy",
        type=Path,
        metavar="CHECKPOINT",
        help="policy.npz, or the folder of a training run (default: the one that comes with gfm)",
    )
    parser.add_argument(
        "--trials", type=int, default=5, metavar="N", help="attempts per goal (default: 5)"
    )
