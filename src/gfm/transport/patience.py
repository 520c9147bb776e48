"""How long a link may be silent or stuck, for zenoh and for the kernel below it.

zenoh gives a silent link up by itself, but by TLS waits until the kernel has sent what is left. To
a side that has vanished the kernel sends for some 15 minutes. One that joins again meanwhile is
taken for the old one, whose end then ends both: it is connected, and hears nobody for ever. So the
kernel has to give up before zenoh does. zenoh has no setting for that: its sockets are told.
"""

from __future__ import annotations

import os
import socket
import stat
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import final

import zenoh
from zenoh.handlers import RingChannel

LEASE_S = 4.0
"""Silence after which zenoh gives a link up; an idle one is heard of four times as often."""

STUCK_S = LEASE_S / 2
"""How long the other side may take nothing of what it is sent, before zenoh or the kernel ends it.

A router that waits for room to send reads from nobody else: before they take it for silent, it has
to go on."""


@final
class BoundedLinks:
    """The links of a session: no connection below one stays stuck for long."""

    def __init__(self, session: zenoh.Session, ports: Sequence[int]) -> None:
        """Bounds what is there; what a listening socket accepts later has its bound from that.

        Args:
            session: Whose links they are.
            ports: On which it listens, or to which it connects.
        """
        self._ports = ports
        self._events = session.info.declare_link_events_listener(RingChannel(1))
        self._bound_all()

    def look(self) -> None:
        """Bounds what has come since: a client that has lost its router connects anew."""
        with suppress(zenoh.ZError):  # the session is closed
            if self._events.try_recv() is not None:
                self._bound_all()

    def _bound_all(self) -> None:
        for port in self._ports:
            _bound(port)


def _bound(port: int) -> None:
    """Lets the kernel end connections from or to a port that are stuck.

    Where the kernel knows no such bound, nothing is done.
    """
    option = getattr(socket, "TCP_USER_TIMEOUT", None)
    if option is None:
        return
    for connection in tcp_sockets():
        with connection, suppress(OSError):  # one that just ends
            if port in ports_of(connection):
                connection.setsockopt(socket.IPPROTO_TCP, option, round(STUCK_S * 1e3))


def tcp_sockets() -> Iterator[socket.socket]:
    """Yields this process's TCP sockets, each to be closed: they are copies of what zenoh holds."""
    for number in map(int, os.listdir("/proc/self/fd")):  # noqa: PTH208
        with suppress(OSError):  # closed since
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                copy = socket.socket(fileno=os.dup(number))
                if copy.family in (socket.AF_INET, socket.AF_INET6) and (
                    copy.type is socket.SOCK_STREAM
                ):
                    yield copy
                else:
                    copy.close()


def ports_of(connection: socket.socket) -> list[int]:
    """Returns the ports of both sides, as far as there are two."""
    ports = [connection.getsockname()[1]]
    with suppress(OSError):  # it listens
        ports.append(connection.getpeername()[1])
    return ports
