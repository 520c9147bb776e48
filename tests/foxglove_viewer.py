"""A viewer's side of Foxglove's protocol over a websocket."""

from __future__ import annotations

import json
import socket
import struct
from typing import Any

from websockets.sync.client import connect


class Foxglove:
    """A viewer's side of Foxglove's protocol.

    Attributes:
        channels: As they were advertised, by topic.
    """

    def __init__(self, port: int) -> None:
        address, protocol = f"ws://127.0.0.1:{port}", "foxglove.sdk.v1"
        self._line = connect(address, subprotocols=[protocol], ping_interval=None, legacy=True)  # type: ignore[list-item]
        self.channels: dict[str, dict[str, Any]] = {}
        self._topics: dict[int, str] = {}

    def advertised(self, *topics: str) -> None:
        """Waits until topics are advertised."""
        while not set(topics) <= self.channels.keys():
            text = self._line.recv(timeout=10.0)
            said = json.loads(text)
            if said["op"] == "advertise":
                self.channels |= {one["topic"]: one for one in said["channels"]}

    def subscribe(self, *topics: str) -> None:
        self.advertised(*topics)
        asked = []
        for topic in topics:
            number = self.channels[topic]["id"]
            self._topics[number] = topic
            asked.append({"id": number, "channelId": number})
        self._line.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    def received(self, wait_s: float = 10.0) -> tuple[str, int, bytes] | None:
        """Returns topic, stamp and body of the next message; None where none comes."""
        message: str | bytes = ""
        while isinstance(message, str):  # such as what is advertised meanwhile
            try:
                message = self._line.recv(timeout=wait_s)
            except TimeoutError:
                return None
        code, number, stamp_ns = struct.unpack_from("<BIQ", message)
        assert code == 1
        return self._topics[number], stamp_ns, message[13:]

    def leave(self) -> None:
        self._line.close()

    def vanish(self) -> None:
        """Goes without a word."""
        self._line.socket.shutdown(socket.SHUT_RDWR)
