"""The line of the fault benchmarks: it passes bytes on, can be cut, and keeps no handles."""

from __future__ import annotations

import socket
import threading
import time
from pathlib import Path

import pytest
from relay import Relay


@pytest.fixture
def echo():
    """Yields the port of a server that sends back what it gets."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve(one):
        with one:
            while data := one.recv(1000):
                one.sendall(data)

    def accept():
        while True:
            try:
                one = listener.accept()[0]
            except OSError:
                return
            threading.Thread(target=serve, args=(one,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    yield listener.getsockname()[1]
    listener.shutdown(socket.SHUT_RDWR)
    listener.close()


def said(port: int, text: bytes) -> bytes:
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as client:
        client.sendall(text)
        return client.recv(1000)


def handles() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def test_connections_that_have_ended_leave_no_handles(echo):
    line = Relay(echo)
    said(line.port, b"first")
    before = handles()
    for number in range(30):
        assert said(line.port, b"%d" % number) == b"%d" % number
    deadline_s = time.monotonic() + 5.0
    while handles() > before + 2 and time.monotonic() < deadline_s:
        time.sleep(0.01)
    assert handles() <= before + 2
    line.cut()


def test_a_cut_ends_what_is_connected_and_lets_nobody_in(echo):
    line = Relay(echo)
    with socket.create_connection(("127.0.0.1", line.port), timeout=5.0) as client:
        client.sendall(b"x")
        assert client.recv(10) == b"x"
        line.cut()
        assert client.recv(10) == b""
    with pytest.raises(OSError, match="refused"):
        said(line.port, b"x")
