"""The command `gfm metrics`."""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Callable
from functools import partial
from threading import Thread
from typing import TYPE_CHECKING

from gfm.core import MonotonicClock
from gfm.core.extras import needs
from gfm.launch.flags import add_endpoint, address_of
from gfm.launch.live_page import live_page
from gfm.launch.overview import Onlooker
from gfm.launch.place import add_insecure, place_to_serve
from gfm.launch.web import application, listening
from gfm.service import StopSignal, start_logging
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
    add_insecure(parser)
    add_endpoint(parser, "--connect", "the system's router")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serves until told to stop."""
    host, port = place_to_serve("--http", arguments.http, insecure=arguments.insecure)
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
