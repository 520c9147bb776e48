"""Where processes listen and connect: what is allowed with certificates, and what without."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Sequence

from gfm.core import ConfigError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a run's router is looked for unless another place is named."""

DEFAULT_SECURE_ENDPOINT = "tls/127.0.0.1:7447"
"""The same with certificates."""

_ENDPOINT = re.compile(r"(?P<link>tcp|tls)/(?P<host>[^/\s:]+|\[[0-9a-fA-F:]+\]):(?P<port>\d{1,5})")


def default_endpoint(*, secure: bool) -> str:
    """Returns where a run's router is looked for, with or without certificates."""
    return DEFAULT_SECURE_ENDPOINT if secure else DEFAULT_ENDPOINT


def check_endpoints(
    listen: Sequence[str], connect: Sequence[str], *, secure: bool, insecure: bool = False
) -> None:
    """Refuses endpoints that are malformed, or let anybody in.

    Args:
        listen: Where to listen.
        connect: Where to connect.
        secure: Whether there are certificates: then all must be by TLS.
        insecure: Whether anybody who reaches them may come in: without certificates that must be
            meant, on loopback, too, where other users of the machine are.

    Raises:
        ConfigError: there is none, one is not as it has to be, or settings contradict each other.
    """
    if not listen and not connect:
        raise ConfigError("no endpoint: give one to listen on or one to connect to")
    for endpoint in listen:
        _check(endpoint, secure=secure, otherwise=", or --insecure in their place")
    for endpoint in connect:
        _check(endpoint, secure=secure)
    if secure and insecure:
        raise ConfigError("insecure, and certificates: expected one of them")
    if secure and listen and connect:
        raise ConfigError(
            f"certificates, and endpoints to listen on ({', '.join(listen)}) and to connect to "
            f"({', '.join(connect)}): expected one of these, a router connects to nobody"
        )
    for endpoint in listen:
        if not (secure or insecure):
            raise ConfigError(
                f"endpoint {endpoint!r} without certificates lets anybody who reaches it read, "
                "publish and command: expected tls/HOST:PORT with --certs, or --insecure where "
                "that is meant"
            )


def _check(endpoint: str, *, secure: bool, otherwise: str = "") -> None:
    link = "tls" if secure else "tcp"
    words = f"endpoint {endpoint!r} with{'' if secure else 'out'} certificates"
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or match["link"] != link:
        raise ConfigError(f"{words}: expected {link}/HOST:PORT{otherwise if secure else ''}")
    if secure and match["host"].startswith("["):  # zenoh takes it for a name, and finds none
        raise ConfigError(f"{words}: expected a host's name or an IPv4 address")


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Returns the parts of an endpoint; of an IPv6 address without its brackets."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None:
        raise ConfigError(f"endpoint {endpoint!r}: expected tcp/HOST:PORT or tls/HOST:PORT")
    return match["host"].strip("[]"), int(match["port"])


def is_loopback(host: str) -> bool:
    """Returns whether only processes of this machine can connect to a host's name or address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
