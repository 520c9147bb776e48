"""The door that is a websocket."""

from __future__ import annotations

import itertools
import queue
import threading
from collections.abc import Mapping
from typing import Any, final

import msgspec
from typing_extensions import override
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import Server, ServerConnection, serve

from gfm.core import ConfigError
from gfm_robot_bridge.rosbridge_sawyer.door import Door, Said

#: Messages that wait for a client: some seconds. One that is further behind is sent away.
_WAITING = 1000


@final
class WebsocketDoor(Door):
    """Listens on an address, with two threads for each client.

    Args:
        host: To listen on.
        port: To listen on.

    Raises:
        ConfigError: somebody else does.
    """

    def __init__(self, host: str, port: int) -> None:
        self._said: queue.SimpleQueue[Said] = queue.SimpleQueue()
        self._clients: dict[int, queue.Queue[str | None]] = {}
        self._numbers = itertools.count()
        try:
            self._server: Server = serve(self._hear, host, port, compression=None)
        except OSError as exc:
            raise ConfigError(
                f"ros is {host}:{port}: {exc.strerror}; expected a free port"
            ) from exc
        self._thread = threading.Thread(
            target=self._server.serve_forever, name="rosbridge", daemon=True
        )
        self._thread.start()

    @override
    def receive(self) -> Said | None:
        try:
            return self._said.get_nowait()
        except queue.Empty:
            return None

    @override
    def send(self, client: int, op: Mapping[str, Any]) -> None:
        waiting = self._clients.get(client)
        if waiting is None:
            return
        try:
            waiting.put_nowait(msgspec.json.encode(op).decode())
        except queue.Full:
            self._clients.pop(client, None)

    @override
    def close(self) -> None:
        self._server.shutdown()
        self._thread.join()

    def _hear(self, connection: ServerConnection) -> None:
        client, waiting = next(self._numbers), queue.Queue[str | None](_WAITING)
        self._clients[client] = waiting
        writer = threading.Thread(target=self._tell, args=(connection, waiting), daemon=True)
        writer.start()
        try:
            for text in connection:
                self._said.put(Said(client=client, op=_decoded(text)))
        except ConnectionClosed:
            pass  # however it ended, it is gone
        finally:
            self._clients.pop(client, None)
            self._said.put(Said(client=client, op=None))
            waiting.put(None)
            writer.join()

    def _tell(self, connection: ServerConnection, waiting: queue.Queue[str | None]) -> None:
        try:
            while (text := waiting.get()) is not None:
                connection.send(text)
        except ConnectionClosed:
            while waiting.get() is not None:
                pass


def _decoded(text: str | bytes) -> dict[str, Any]:
    try:
        return msgspec.json.decode(text, type=dict)
    except msgspec.DecodeError as error:
        return {"op": f"no JSON object: {error}"}
