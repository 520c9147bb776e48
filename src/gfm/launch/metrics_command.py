"""The command `gfm metrics`."""

from __future__ import annotations

import argparse
import logging
import re
import time
from collections.abc import Callable
from functools import partial
from threading import Thread
from typing import TYPE_CHECKING

from gfm.core import ConfigError, MonotonicClock
from gfm.core.extras import needs
from gfm.launch.flags import add_endpoint, address_of
from gfm.launch.live_page import live_page
from gfm.launch.overview import Onlooker
from gfm.launch.web import application, listening
from gfm.service import StopSignal, start_logging
from gfm.transport import is_loopback
from gfm_wire import Role

if TYPE_CHECKING:
    from prometheus_client.registry import Collector

    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_log = logging.getLogger(__name__)

_DESCRIPTION = """\
Serves what the services of a running system say of themselves: as a page for people, at /, which
reads on a phone, and to Prometheus, at /metrics. It asks them whenever it is asked.
"""
_DEFAULT = "127.0.0.1:9464"
_PLACE = re.compile(r"(?P<host>[^/\s:]+|\[[0-9a-fA-F:]+\]):(?P<port>\d{1,5})")
_ASK_S = 3.0
_LOOK_S = 0.2


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm metrics`."""
    parser = subparsers.add_parser(
        "metrics", help="serve a system's numbers: a page, Prometheus", description=_DESCRIPTION
    )
    parser.add_argument(
        "--http", default=_DEFAULT, metavar="HOST:PORT", help="where (default: %(default)s)"
    )
    parser.add_argument(
        "--insecure",
        action="store_true",
        help="serve beyond this machine: anybody there may read, without certificates",
    )
    add_endpoint(parser, "--connect", "the system's router")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serves until told to stop."""
    host, port = place(arguments.http, insecure=arguments.insecure)
    with needs("metrics need", "prometheus_client", "metrics"):
        from gfm.launch.prometheus import RunCollector
    start_logging("info")
    stopped = StopSignal()
    address = address_of(arguments)
    with address.open(Role.WATCHER, name="metrics") as transport:
        stopped.install()
        onlooker = Onlooker(transport, MonotonicClock(), timeout_s=_ASK_S)
        page = partial(_page, onlooker, address.run)
        _serve(RunCollector(transport, timeout_s=_ASK_S), page, host, port, stopped)
    return 0


def place(text: str, *, insecure: bool) -> tuple[str, int]:
    """Returns host and port of HOST:PORT.

    Raises:
        ConfigError: it is none, or lets everybody read where that was not said.
    """
    match = _PLACE.fullmatch(text)
    if match is None or int(match["port"]) > 65535:
        raise ConfigError(f"--http {text!r}: expected HOST:PORT")
    host = match["host"].strip("[]")
    if not insecure and not is_loopback(host):
        raise ConfigError(
            f"--http {text} lets anybody on the network read: expected an address of this machine "
            "alone (127.0.0.1), or --insecure where that is meant"
        )
    return host, int(match["port"])


def _page(onlooker: Onlooker, run_name: str) -> str:
    return live_page(onlooker.look(), run_name)


def _serve(
    collector: Collector, page: Callable[[], str], host: str, port: int, stopped: Callable[[], bool]
) -> None:
    from prometheus_client import CollectorRegistry, make_wsgi_app

    registry = CollectorRegistry()
    registry.register(collector)
    server = listening(host, port, application(make_wsgi_app(registry), page))
    thread = Thread(target=server.serve_forever, name="http", daemon=True)
    thread.start()
    where = f"http://[{host}]:{server.port}" if ":" in host else f"http://{host}:{server.port}"
    _log.info("serving a page at %s/ and metrics at %s/metrics", where, where)
    try:
        while not stopped():
            time.sleep(_LOOK_S)
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
