"""The command `gfm-learner`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from gfm.core import Clock
from gfm.service import Service, make_parser, service_main
from gfm.service.assets import load_environment
from gfm.service.environment_flags import add_environment_flags
from gfm.service.metrics import FolderMetrics, NoMetrics
from gfm.transport import Transport
from gfm_learner.checkpoint import begin
from gfm_learner.config import LearnerConfig
from gfm_learner.service import LearnerService


def build(config: LearnerConfig, transport: Transport, clock: Clock) -> Service:
    """Returns the service that the settings describe."""
    torch.set_num_threads(config.threads)
    environment = load_environment(config.env, config.environment, num_envs=1, seed=config.seed)
    progress = begin(config, environment.spec)
    folder = config.checkpoint_dir
    metrics = FolderMetrics(Path(folder)) if folder else NoMetrics()
    return LearnerService(config, progress, transport, clock, metrics)


def make_learner_parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    parser = make_parser(
        "gfm-learner",
        "Improves a policy by MPO with Retrace on batches from the replay service, and sends it to "
        "the actors.",
    )
    add_environment_flags(parser)
    group = parser.add_argument_group("learning")
    group.add_argument("--batch-size", type=int, metavar="N", help="sequences per step")
    group.add_argument("--max-steps", type=int, metavar="N", help="stop learning after N steps")
    group.add_argument("--init", metavar="FILE", help="policy weights to start from (.npz)")
    group.add_argument("--seed", type=int, help="of first weights and sampled actions")
    group.add_argument("--threads", type=int, metavar="N", help="threads of torch (default: 1)")
    group.add_argument("--device", help="device of torch (default: cpu)")
    group = parser.add_argument_group("checkpoints")
    group.add_argument(
        "--checkpoint-dir", metavar="DIR", help="keep checkpoint, policy and metrics here"
    )
    group.add_argument(
        "--checkpoint-period-s", type=float, metavar="SECONDS", help="time between checkpoints"
    )
    group.add_argument(
        "--no-resume",
        dest="resume",
        action="store_false",
        help="begin anew, also where the folder has a checkpoint",
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the learner until it is told to stop."""
    return service_main(make_learner_parser(), LearnerConfig, build, argv)


if __name__ == "__main__":
    sys.exit(main())
