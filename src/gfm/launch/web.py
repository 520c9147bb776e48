"""What `gfm metrics` serves over HTTP: the page at /, Prometheus's numbers at /metrics."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterable
from socketserver import ThreadingMixIn
from typing import TYPE_CHECKING, Any, final
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from typing_extensions import override

from gfm.core import BadInputError
from gfm.launch.live_page import POLICY

if TYPE_CHECKING:
    from wsgiref.types import StartResponse, WSGIApplication, WSGIEnvironment

_SAFE = [("X-Content-Type-Options", "nosniff"), ("Referrer-Policy", "no-referrer")]


class Server(ThreadingMixIn, WSGIServer):
    """A thread per request; none keeps the process alive."""

    daemon_threads = True

    @property
    def port(self) -> int:
        """On which it listens."""
        return self.server_port


@final
class _Server6(Server):
    """The same on an address of IPv6."""

    address_family = socket.AF_INET6


@final
class _Quiet(WSGIRequestHandler):
    """Who asked what is not logged: that would be a line every few seconds."""

    @override
    def log_message(self, format: str, *args: Any) -> None:
        pass


def application(metrics: WSGIApplication, page: Callable[[], str]) -> WSGIApplication:
    """Returns what answers requests.

    Args:
        metrics: Answers those for /metrics.
        page: Makes the page of now.
    """

    def answer(environ: WSGIEnvironment, start: StartResponse) -> Iterable[bytes]:
        path = environ.get("PATH_INFO", "")
        if path == "/metrics":
            return metrics(environ, start)
        if path == "/" and environ["REQUEST_METHOD"] in ("GET", "HEAD"):
            body = page().encode()
            kind = ("Content-Type", "text/html; charset=utf-8")
            policy = ("Content-Security-Policy", POLICY)
            start("200 OK", [kind, policy, ("Cache-Control", "no-store"), *_SAFE])
            return [body]
        start("404 Not Found", [("Content-Type", "text/plain; charset=utf-8"), *_SAFE])
        return [b"expected / or /metrics\n"]

    return answer


def listening(host: str, port: int, app: WSGIApplication) -> Server:
    """Returns a server that is listening; nobody is answered before `serve_forever`.

    Raises:
        BadInputError: the place cannot be listened on.
    """
    kind = _Server6 if ":" in host else Server
    try:
        return make_server(host, port, app, kind, _Quiet)
    except OSError as exc:
        raise BadInputError(f"cannot listen on {host}:{port}: {exc.strerror}") from exc
