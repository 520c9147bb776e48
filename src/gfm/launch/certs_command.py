"""The command `gfm certs`."""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from gfm.core.extras import needs

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Makes an authority of your own and one certificate per role (router, actor, learner ...), by which
the processes of a system prove who they are: give all of them --certs DIR. A machine needs the
folders of the roles that it plays; DIR/authority is needed by nobody but this command. What exists
is kept.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm certs`."""
    parser = subparsers.add_parser(
        "certs", help="make certificates for a system's processes", description=_DESCRIPTION
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where they go")
    parser.add_argument(
        "--host",
        dest="hosts",
        action="append",
        default=[],
        metavar="NAME",
        help="name or IPv4 address under which others reach the router, besides localhost "
        "(may be repeated)",
    )
    parser.add_argument(
        "--days", type=int, default=365, metavar="N", help="how long they last (default: 365)"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Makes what is missing, and says what that was."""
    with needs("certificates need", "cryptography", "certs"):
        from gfm.launch.certs import make_certificates
    made = make_certificates(arguments.out, arguments.hosts, arguments.days, datetime.now(UTC))
    for folder, is_new in made:
        sys.stdout.write(f"{folder}: {'made' if is_new else 'kept'}\n")
    return 0
