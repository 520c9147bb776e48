"""The line to a rosbridge over a websocket: a thread that reads, and one that writes in time."""

from __future__ import annotations

import logging
import socket
import threading
from collections import deque
from collections.abc import Sequence
from typing import final

import msgspec
from typing_extensions import override
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

from gfm.core import Clock
from gfm_robot_bridge.intera.link import Arrived, Due, Link, Op

_log = logging.getLogger(__name__)

_OPEN_TIMEOUT_S = 2.0
_CLOSE_TIMEOUT_S = 1.0
#: The network may be away for so long, ms; then the operating system ends the connection and what
#: it has not delivered is forgotten, instead of reaching the robot when nobody means it any more.
_UNACKNOWLEDGED_MS = 500
#: What the operating system takes before a write waits, bytes: a tenth of a second of setpoints.
_SEND_BUFFER = 16_384
#: Messages that wait to be read, or to be sent beside a plan: more is a mistake, and ends the line.
_MOST_ARRIVED, _MOST_SAID = 4096, 256


@final
class WebsocketLink(Link):
    """Connects to `ws://HOST:PORT`.

    Args:
        host: Where the rosbridge listens.
        port: On which port.
        clock: Of this process.
    """

    def __init__(self, host: str, port: int, clock: Clock) -> None:
        self.peer = f"rosbridge at {host}:{port}"
        self._address = host, port
        self._clock = clock
        self._session: _Session | None = None

    @override
    def open(self) -> None:
        self.drop("it is opened anew")
        self._session = _Session(*self._address, self._clock)

    @property
    @override
    def is_open(self) -> bool:
        return self._session is not None and self._session.is_open

    @property
    @override
    def problem(self) -> str:
        return "" if self._session is None else self._session.problem

    @override
    def say(self, op: Op) -> None:
        if self._session is not None:
            self._session.say(op)

    @override
    def plan(self, ops: Sequence[Due]) -> None:
        if self._session is not None:
            self._session.plan(ops)

    @override
    def receive(self) -> list[Arrived]:
        return [] if self._session is None else self._session.receive()

    @override
    def drop(self, why: str) -> None:
        if self._session is not None:
            self._session.end(why)

    @override
    def close(self) -> None:
        if self._session is not None:
            self._session.finish()


@final
class _Session:
    """One connection, from its beginning to its end."""

    def __init__(self, host: str, port: int, clock: Clock) -> None:
        self.problem = ""
        self.is_open = False
        self._address = host, port
        self._clock = clock
        self._socket: socket.socket | None = None
        self._changed = threading.Condition()
        self._said: deque[Op] = deque()
        self._planned: deque[Due] = deque()
        self._finishing = False
        self._arrived: deque[Arrived] = deque()
        self._reader = threading.Thread(target=self._run, name="rosbridge reader", daemon=True)
        self._reader.start()

    def say(self, op: Op) -> None:
        with self._changed:
            if self.is_open:
                self._said.append(op)
                self._changed.notify()
        if len(self._said) > _MOST_SAID:
            self.end("it takes nothing")

    def plan(self, ops: Sequence[Due]) -> None:
        with self._changed:
            if self.is_open:
                self._planned = deque(ops)
                self._changed.notify()

    def receive(self) -> list[Arrived]:
        return [self._arrived.popleft() for _ in range(len(self._arrived))]

    def end(self, why: str) -> None:
        """Ends at once; the first reason stays."""
        with self._changed:
            if self.problem:
                return
            self.problem, self.is_open = why, False
            self._changed.notify()
        if self._socket is not None:
            # Wakes both threads, whatever they wait for.
            try:
                self._socket.shutdown(socket.SHUT_RDWR)
            except OSError:
                _log.debug("the connection was gone already")

    def finish(self) -> None:
        """Sends what waits, then ends."""
        with self._changed:
            self._finishing = True
            self._changed.notify()
        self._reader.join(_CLOSE_TIMEOUT_S if self.is_open else 0.0)
        self.end("it is closed")

    def _run(self) -> None:
        try:
            with self._connected() as connection:
                with self._changed:
                    self.is_open = not self.problem
                writer = threading.Thread(
                    target=self._write, args=(connection,), name="rosbridge writer", daemon=True
                )
                writer.start()
                for text in connection:
                    self._take(text)
            self.end("it closed the connection")
        except (OSError, WebSocketException) as error:
            self.end(f"{error}" or type(error).__name__)

    def _connected(self) -> ClientConnection:
        host, port = self._address
        raw = socket.create_connection(self._address, _OPEN_TIMEOUT_S)
        raw.settimeout(None)
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNACKNOWLEDGED_MS)
        self._socket = raw
        return connect(
            f"ws://{host}:{port}",
            sock=raw,
            compression=None,
            open_timeout=_OPEN_TIMEOUT_S,
            close_timeout=_CLOSE_TIMEOUT_S,
            proxy=None,
        )

    def _take(self, text: str | bytes) -> None:
        try:
            op = msgspec.json.decode(text, type=dict)
        except msgspec.DecodeError as error:
            op = {"op": f"what is no JSON object ({error})"}
        if len(self._arrived) >= _MOST_ARRIVED:
            self.end("what it says is not read")
        self._arrived.append(Arrived(op=op, at_ns=self._clock.now_ns()))

    def _write(self, connection: ClientConnection) -> None:
        try:
            while (op := self._next()) is not None:
                connection.send(msgspec.json.encode(op).decode())
            connection.close()
        except (OSError, WebSocketException) as error:
            self.end(f"{error}" or type(error).__name__)

    def _next(self) -> Op | None:
        """Waits for what is to be sent next; returns None at the end."""
        with self._changed:
            while not self.problem:
                if self._said:
                    return self._said.popleft()
                wait_s = None
                if self._planned:
                    now_ns, due = self._clock.now_ns(), self._planned[0]
                    if due.at_ns <= now_ns:
                        self._planned.popleft()
                        if due.until_ns is None or now_ns <= due.until_ns:
                            return due.op
                        continue
                    wait_s = (due.at_ns - now_ns) * 1e-9
                elif self._finishing:
                    return None
                self._changed.wait(wait_s)
        return None
