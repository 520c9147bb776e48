"""Flags of every command that joins a run."""

from __future__ import annotations

import argparse

from gfm.service import DEFAULT_ENDPOINT


def add_endpoint(parser: argparse.ArgumentParser, flag: str, meaning: str) -> None:
    """Adds a flag for a router's endpoint, and `--run`."""
    parser.add_argument(
        flag, default=DEFAULT_ENDPOINT, metavar="ENDPOINT", help=f"{meaning} (default: %(default)s)"
    )
    # Not `run`: that is where the parsers keep the function to call.
    parser.add_argument(
        "--run",
        dest="run_name",
        default="default",
        metavar="NAME",
        help="name of the run; runs that share a router don't meet (default: %(default)s)",
    )
