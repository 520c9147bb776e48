"""The command `gfm-actor`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from gfm.core import Clock
from gfm.service import Service, make_parser, service_main
from gfm.service.assets import load_environment
from gfm.service.environment_flags import add_environment_flags
from gfm.transport import Transport
from gfm_actor.config import ActorConfig
from gfm_actor.joining import complete
from gfm_actor.service import ActorService


def build(config: ActorConfig, transport: Transport, clock: Clock) -> Service:
    """Returns the service that the settings, and the run it joins, describe."""
    config = complete(config, transport, clock)
    seed = config.chosen_seed
    env = load_environment(config.env, config.environment, num_envs=config.num_envs, seed=seed)
    return ActorService(config, env, transport, clock, np.random.default_rng(seed))


def make_actor_parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    parser = make_parser(
        "gfm-actor",
        "Acts in many instances of an environment with the learner's newest policy and sends what "
        "happened to the replay service. Told nothing about the environment, it asks the learner.",
    )
    add_environment_flags(parser)
    group = parser.add_argument_group("acting")
    group.add_argument("--num-envs", type=int, metavar="N", help="instances stepped together")
    group.add_argument("--sequence-length", type=int, metavar="T", help="transitions per sequence")
    group.add_argument(
        "--max-steps-per-s",
        type=float,
        metavar="RATE",
        help="environment steps per second, at most",
    )
    group.add_argument(
        "--seed", type=int, help="of episodes and sampled actions (default: made from the name)"
    )
    group.add_argument(
        "--ledger", metavar="DIR", help="note there what replay acknowledged (default: nowhere)"
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the actor until it is told to stop."""
    return service_main(make_actor_parser(), ActorConfig, build, argv)


if __name__ == "__main__":
    sys.exit(main())
