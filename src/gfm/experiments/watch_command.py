"""The command `gfm watch`."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING

from gfm.core import ConfigError, MonotonicClock
from gfm.core.extras import needs
from gfm.launch.flags import add_endpoint, address_of
from gfm.launch.place import add_insecure, place, place_to_serve
from gfm.service import StopSignal, start_logging

if TYPE_CHECKING:
    from gfm.live.viewer import Viewer

    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_log = logging.getLogger(__name__)

_DESCRIPTION = """\
Shows a robot while it is driven, in Foxglove or in Rerun, with the topics of its recordings. It
watches the bridge of a running system and can't command anything; a slow viewer, or none, is
nothing that the bridge notices. Ctrl-C ends it. Needs the extra `foxglove` or `rerun`.
"""
_FOXGLOVE, _RERUN = "127.0.0.1:8765", "127.0.0.1:9876"
_JOIN_S = 3.0


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm watch`."""
    parser = subparsers.add_parser(
        "watch", help="show a robot live, in Foxglove or Rerun", description=_DESCRIPTION
    )
    parser.add_argument(
        "--foxglove",
        nargs="?",
        const=_FOXGLOVE,
        metavar="HOST:PORT",
        help="serve viewers of Foxglove there (without a value: %(const)s)",
    )
    parser.add_argument(
        "--rerun",
        nargs="?",
        const=_RERUN,
        metavar="HOST:PORT",
        help="send to a viewer of Rerun that is open there (without a value: %(const)s)",
    )
    parser.add_argument(
        "--wait-s",
        type=float,
        default=10.0,
        metavar="SECONDS",
        help="how long to wait for a bridge (default: %(default)s)",
    )
    add_insecure(parser)
    add_endpoint(parser, "--connect", "the system's router")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Shows a robot until told to stop."""
    if arguments.foxglove is None and arguments.rerun is None:
        raise ConfigError("no viewer is named; expected --foxglove, --rerun, or both")
    if not 0.0 < arguments.wait_s < float("inf"):
        raise ConfigError(f"--wait-s is {arguments.wait_s:g}, expected more than 0")
    start_logging("info")
    clock, stopped = MonotonicClock(), StopSignal()
    with ExitStack() as stack:
        viewers = [stack.enter_context(viewer) for viewer in _viewers(arguments)]
        address = address_of(arguments)
        transport = stack.enter_context(address.watch(name="watch", timeout_s=_JOIN_S))
        stopped.install()
        from gfm.live.watching import Watching

        watching = Watching(transport, viewers, clock)
        watching.watch(stopped, arguments.wait_s)
        heard = watching.heard
        _log.info("%d periods shown, %d lost", heard.periods, heard.lost)
    return 0


def _viewers(arguments: argparse.Namespace) -> Iterator[Viewer]:
    """Yields those that are asked for."""
    if arguments.foxglove is not None:
        place_asked = ("--foxglove", arguments.foxglove)
        host, port = place_to_serve(*place_asked, insecure=arguments.insecure)
        yield _foxglove(host, port)
    if arguments.rerun is not None:
        yield _rerun(*place("--rerun", arguments.rerun))


def _foxglove(host: str, port: int) -> Viewer:
    with needs("--foxglove needs", "foxglove", "foxglove"):
        from gfm.live.foxglove_server import FoxgloveServer

    server = FoxgloveServer(host, port)
    where = f"[{host}]" if ":" in host else host
    _log.info("Foxglove: open the connection ws://%s:%d", where, server.port)
    return server


def _rerun(host: str, port: int) -> Viewer:
    with needs("--rerun needs", "rerun", "rerun"):
        from gfm.live.rerun_stream import connected

    viewer = connected(host, port)
    _log.info("Rerun: its viewer at %s:%d shows the robot", host, port)
    return viewer
