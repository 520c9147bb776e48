"""A line between two processes of this machine that can be cut, or fall silent."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from typing import final


@final
class Relay:
    """Passes bytes on, both ways, until it is cut; a cut closes every connection at once.

    Args:
        port: Of the server on this machine.
        own_port: On which to listen; 0 takes a free one.

    Attributes:
        port: On which it listens.
    """

    def __init__(self, port: int, own_port: int = 0) -> None:
        self._target = port
        self._passing = [threading.Event()]
        self._passing[-1].set()
        self._ends: list[socket.socket] = []
        self._listener = socket.create_server(("127.0.0.1", own_port))
        self.port: int = self._listener.getsockname()[1]
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def cut(self) -> None:
        """Closes all, and returns when that is so."""
        _shut(self._listener)
        self._threads[0].join()
        for end in self._ends:
            _shut(end)
        for passing in self._passing:
            passing.set()
        for thread in self._threads:
            thread.join()
        for end in (self._listener, *self._ends):
            end.close()

    def hush(self) -> None:
        """Lets the connections of now be silent for ever, as those to an address that has gone.

        They stay open, and take nothing more; later ones pass bytes on.
        """
        self._passing[-1].clear()
        self._passing.append(threading.Event())
        self._passing[-1].set()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                self._join(self._listener.accept()[0])

    def _join(self, near: socket.socket) -> None:
        try:
            far = socket.create_connection(("127.0.0.1", self._target))
        except OSError:  # the server is away: whoever called is told so, and may call again
            near.close()
            return
        # Connections that have ended are forgotten, so that a line of hours holds no more handles.
        self._ends = [end for end in self._ends if end.fileno() >= 0] + [near, far]
        first, *others = self._threads
        self._threads = [first, *(thread for thread in others if thread.is_alive())]
        first_end = threading.Semaphore(1)
        for pair in ((near, far), (far, near)):
            told = (*pair, self._passing[-1], first_end)
            self._threads.append(threading.Thread(target=_pass_on, args=told, daemon=True))
            self._threads[-1].start()


def _pass_on(
    source: socket.socket,
    target: socket.socket,
    passing: threading.Event,
    first_end: threading.Semaphore,
) -> None:
    """Passes bytes on one way; the way that ends last closes both sockets."""
    with suppress(OSError):
        while data := source.recv(65536):
            passing.wait()
            target.sendall(data)
    _shut(source)
    _shut(target)
    if not first_end.acquire(blocking=False):
        source.close()
        target.close()


def _shut(end: socket.socket) -> None:
    with suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
