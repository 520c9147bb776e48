"""Flags of every command that joins a run."""

from __future__ import annotations

import argparse

from gfm.launch.address import RunAddress
from gfm.launch.own_certs import OWN_CERTS, certs_to_join
from gfm.service.command import ENDPOINT_DEFAULTS, INSECURE_HELP

_CERTS_HELP = (
    f"certificates by which all prove who they are (default: {OWN_CERTS}, which `gfm up` and "
    "`gfm router` make)"
)


def add_endpoint(parser: argparse._ActionsContainer, flag: str, meaning: str) -> None:
    """Adds a flag for a router's endpoint, `--run` and `--certs`.

    Args:
        parser: Gets them.
        flag: `--connect`, or `--listen` of a command that starts the router.
        meaning: What its help says.
    """
    parser.add_argument(
        flag,
        dest="endpoint",
        default="",
        metavar="ENDPOINT",
        help=f"{meaning} (default: {ENDPOINT_DEFAULTS})",
    )
    # Not `run`: that is where the parsers keep the function to call.
    parser.add_argument(
        "--run",
        dest="run_name",
        default="default",
        metavar="NAME",
        help="name of the run; runs that share a router don't meet (default: %(default)s)",
    )
    add_certs(parser)
    if flag == "--listen":
        parser.add_argument("--insecure", action="store_true", default=False, help=INSECURE_HELP)


def add_certs(parser: argparse._ActionsContainer) -> None:
    """Adds `--certs`."""
    parser.add_argument("--certs", default="", metavar="DIR", help=_CERTS_HELP)


def address_of(arguments: argparse.Namespace) -> RunAddress:
    """Returns the run to join that the flags of `add_endpoint` name."""
    certs = certs_to_join(arguments.endpoint, arguments.certs)
    return RunAddress(run=arguments.run_name, endpoint=arguments.endpoint, certs=certs)


def router_address_of(arguments: argparse.Namespace) -> RunAddress:
    """Returns the run whose router these flags start; its certificates may not be there yet."""
    certs = arguments.certs or ("" if arguments.insecure else str(OWN_CERTS))
    return RunAddress(run=arguments.run_name, endpoint=arguments.endpoint, certs=certs)
