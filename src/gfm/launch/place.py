"""Where viewers and other tools meet a command: HOST:PORT."""

from __future__ import annotations

import argparse
import re

from gfm.core import ConfigError
from gfm.transport import is_loopback

_PLACE = re.compile(r"(?P<host>[^/\s:]+|\[[0-9a-fA-F:]+\]):(?P<port>\d{1,5})")


def add_insecure(parser: argparse.ArgumentParser) -> None:
    """Adds `--insecure` of commands that serve who does not prove who they are."""
    parser.add_argument(
        "--insecure",
        action="store_true",
        help="serve beyond this machine: anybody there may read, without certificates",
    )


def place(flag: str, text: str) -> tuple[str, int]:
    """Returns host and port of HOST:PORT.

    Args:
        flag: That has it.
        text: Of it.

    Raises:
        ConfigError: it is none.
    """
    match = _PLACE.fullmatch(text)
    if match is None or int(match["port"]) > 65535:
        raise ConfigError(f"{flag} {text!r}: expected HOST:PORT")
    return match["host"].strip("[]"), int(match["port"])


def place_to_serve(flag: str, text: str, *, insecure: bool) -> tuple[str, int]:
    """Returns host and port of HOST:PORT, to listen there.

    Raises:
        ConfigError: it is none, or lets everybody read where that was not said.
    """
    host, port = place(flag, text)
    if not insecure and not is_loopback(host):
        raise ConfigError(
            f"{flag} {text} lets anybody on the network read: expected an address of this machine "
            "alone (127.0.0.1), or --insecure where that is meant"
        )
    return host, port
