"""The command `gfm-replay`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from gfm.core import Clock
from gfm.service import Service, make_parser, service_main
from gfm.transport import Transport
from gfm_replay.config import ReplayConfig
from gfm_replay.service import ReplayService


def build(config: ReplayConfig, transport: Transport, clock: Clock) -> Service:
    """Returns the service that the settings describe."""
    return ReplayService(config, transport, clock, np.random.default_rng(config.seed))


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the replay service until it is told to stop."""
    parser = make_parser(
        "gfm-replay",
        "Keeps the sequences that actors send and hands out batches of them to the learner. "
        "With --listen it is also the router that everybody else connects to.",
        listens=True,
    )
    group = parser.add_argument_group("replay")
    group.add_argument("--capacity-mib", type=int, metavar="MIB", help="memory for sequences")
    group.add_argument(
        "--min-size", type=int, metavar="N", help="sequences to wait for before the first batch"
    )
    group.add_argument(
        "--max-samples-per-insert",
        type=float,
        metavar="RATIO",
        help="hand out each sequence at most this often on average (default: no limit)",
    )
    group.add_argument(
        "--min-samples-per-insert",
        type=float,
        metavar="RATIO",
        help="take no more sequences before each was handed out so often on average "
        "(default: no limit)",
    )
    group.add_argument(
        "--priority-exponent",
        type=float,
        metavar="X",
        help="0 to 1: draw sequences more often about which the learner errs more (default: 0)",
    )
    group.add_argument(
        "--folder",
        metavar="DIR",
        help="keep sequences there, for later processes too (default: in memory)",
    )
    group.add_argument(
        "--max-batch-size", type=int, metavar="N", help="sequences of one batch, at most"
    )
    group.add_argument(
        "--sequence-length",
        type=int,
        metavar="T",
        help="transitions that every sequence must have (default: as many as the first has)",
    )
    group.add_argument("--seed", type=int, help="of the choice of sequences")
    return service_main(parser, ReplayConfig, build, argv)


if __name__ == "__main__":
    sys.exit(main())
