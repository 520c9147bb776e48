"""The command of a service: flags, settings, logging, connection, loop, exit status.

Exit status 0: stopped as asked. 1: a peer stayed away or said no. 2: bad input.
"""

from __future__ import annotations

import argparse
import errno
import logging
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, get_args

import msgspec
from msgspec.structs import replace

from gfm.core import BadInputError, Clock, GfmError, MonotonicClock
from gfm.parser import OneLineParser
from gfm.service.config import ServiceConfig, read_config, unique_name
from gfm.service.heartbeat import make_heartbeat
from gfm.service.logs import LogFormat, LogLevel, start_logging
from gfm.service.loop import run_service
from gfm.service.service import Service
from gfm.service.signals import StopRequested, StopSignal
from gfm.service.sums import make_sums
from gfm.transport import default_endpoint

if TYPE_CHECKING:
    from gfm.transport import ZenohTransport

_log = logging.getLogger(__name__)
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)

ENDPOINT_DEFAULTS = (
    f"{default_endpoint(secure=False)}, with certificates {default_endpoint(secure=True)}"
)
CERTS_HELP = "certificates of `gfm certs`, by which all prove who they are (default: none)"
INSECURE_HELP = (
    "speak without certificates: whoever reaches the router may read, publish and command"
)

Config = TypeVar("Config", bound=ServiceConfig)


def make_parser(
    prog: str, description: str, *, listens: bool = False, joins: bool = True
) -> argparse.ArgumentParser:
    """Returns a parser with the flags that all services share.

    A flag that is not given leaves no trace in the parsed arguments, so that the file's value or
    the default holds. The `dest` of every flag is the name of the setting that it overrides.

    Args:
        prog: The command's name.
        description: What the service does, for a newcomer.
        listens: Whether this service can be the run's router.
        joins: Whether it joins a run at all.
    """
    parser = OneLineParser(prog=prog, description=description, argument_default=argparse.SUPPRESS)
    if joins:
        _add_connection_flags(parser, listens=listens)
    group = parser.add_argument_group("settings")
    group.add_argument(
        "--config", type=Path, metavar="FILE", help="TOML file of settings; flags win over it"
    )
    group.add_argument(
        "--section", metavar="NAME", help="table of that file to read (default: all of it)"
    )
    group.add_argument("--log-level", choices=get_args(LogLevel), help="(default: info)")
    group.add_argument(
        "--log-format", choices=get_args(LogFormat), help="json: an object per line (default: text)"
    )
    return parser


def _add_connection_flags(parser: argparse.ArgumentParser, *, listens: bool) -> None:
    group = parser.add_argument_group("connection")
    group.add_argument("--run", help="name of the run to join (default: default)")
    group.add_argument(
        "--connect",
        metavar="ENDPOINT",
        help=f"the run's router (default: {ENDPOINT_DEFAULTS})",
    )
    group.add_argument("--certs", metavar="DIR", help=CERTS_HELP)
    if listens:
        group.add_argument(
            "--listen",
            metavar="ENDPOINT",
            help=f"be the run's router here, for example {default_endpoint(secure=False)}",
        )
        group.add_argument(
            "--insecure", action="store_true", default=argparse.SUPPRESS, help=INSECURE_HELP
        )
    group.add_argument(
        "--wait-s", type=float, metavar="SECONDS", help="how long to wait for the router"
    )
    group.add_argument("--name", help="unique name within the run (default: from host and pid)")
    group.add_argument(
        "--heartbeat-file", metavar="FILE", help="touch this while all is well, for a supervisor"
    )
    group.add_argument(
        "--sums-file",
        metavar="FILE",
        help="go on with the counts in it, or in NAME.json of a folder (default: from zero)",
    )


def parse_config(
    parser: argparse.ArgumentParser, config_type: type[Config], argv: Sequence[str] | None
) -> Config:
    """Returns the settings that a command line asks for; the name is always filled in."""
    flags = vars(parser.parse_args(argv))
    path: Path | None = flags.pop("config", None)
    section: str = flags.pop("section", "")
    config = read_config(config_type, path, flags, section)
    return config if config.name else replace(config, name=unique_name(parser.prog))


def open_transport(config: ServiceConfig) -> ZenohTransport:
    """Returns the connection that the settings describe."""
    from gfm.transport import ZenohTransport  # nothing else here needs zenoh

    return ZenohTransport.open(
        run=config.run,
        name=config.name,
        listen=config.listen_endpoints,
        connect=config.connect_endpoints,
        timeout_s=config.wait_s,
        credentials=config.credentials(),
        insecure=config.insecure,
    )


def service_main(
    parser: argparse.ArgumentParser,
    config_type: type[Config],
    build: Callable[[Config, ZenohTransport, Clock], Service],
    argv: Sequence[str] | None = None,
) -> int:
    """Runs one service process from its command line to its exit status."""
    return exit_status(lambda: serve(parse_config(parser, config_type, argv), build))


def serve(config: Config, build: Callable[[Config, ZenohTransport, Clock], Service]) -> None:
    """Joins the run that the settings name and runs what `build` makes of them until a signal."""
    who = {"run": config.run, "role": str(config.role), "service": config.name}
    start_logging(config.log_level, config.log_format, who)
    _log.info("settings: %s", msgspec.json.encode(config).decode())
    clock = MonotonicClock()
    heartbeat = make_heartbeat(config.heartbeat_file, clock)
    sums = make_sums(config.sums_file, config.name, clock)
    with open_transport(config) as transport, suppress(StopRequested):
        stopped = StopSignal()
        stopped.install()
        _log.info("connected")
        with stopped.at_once():
            service = build(config, transport, clock)
        _log.info("running")
        run_service(service, transport, clock, stopped, heartbeat, sums)
    _log.info("stopped")


def exit_status(run: Callable[[], int | None]) -> int:
    """Runs a command; an error raised on purpose becomes one line on stderr and a status.

    Args:
        run: Returns a status of its own, or None for 0.
    """
    try:
        return run() or 0
    except GfmError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2 if isinstance(error, BadInputError) else 1
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        where = error.filename or "a file that was being written"
        sys.stderr.write(f"error: {where}: {os.strerror(error.errno)}; expected room to write\n")
        return 2
    except KeyboardInterrupt:
        return 130
