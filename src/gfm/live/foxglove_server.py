"""A server for Foxglove: the messages of recordings over its websocket protocol."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import final

import mcap_ros2.writer
from foxglove import Channel, Context, Schema, start_server
from foxglove.websocket import ChannelView, Client, ServerListener
from typing_extensions import override

from gfm.core import BadInputError
from gfm.live.viewer import Viewer
from gfm.recording.schemas import DESCRIPTION, FIXED_FRAMES, MessageType

#: Messages that wait for one viewer; the oldest are dropped. At 50 periods a second they are those
#: of some three seconds.
_BACKLOG = 1024
#: What is said once, and whoever comes later has to hear, too.
_LASTING = (DESCRIPTION, FIXED_FRAMES)
_Encoder = Callable[[Mapping[str, object]], bytes]


@final
class FoxgloveServer(Viewer):
    """Serves any number of viewers.

    Args:
        host: Where to listen.
        port: The same; 0 for any that is free.

    Attributes:
        port: On which it listens.

    Raises:
        BadInputError: the place cannot be listened on.
    """

    def __init__(self, host: str, port: int) -> None:
        self._context = Context()
        self._channels: dict[str, Channel] = {}
        self._encoders: dict[str, _Encoder] = {}
        self._said: dict[str, tuple[bytes, int]] = {}
        self._came: deque[str] = deque()
        try:
            self._server = start_server(
                name="gfm",
                host=host,
                port=port,
                context=self._context,
                server_listener=_Arrivals(self._came),
                message_backlog_size=_BACKLOG,
            )
        except (RuntimeError, OSError) as exc:
            raise BadInputError(f"cannot listen on {host}:{port} for Foxglove: {exc}") from exc
        self.port: int = self._server.port

    @override
    def write_message(
        self, topic: str, kind: MessageType, message: Mapping[str, object], stamp_ns: int
    ) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._channel(topic, kind)
        body = self._encoder(kind)(message)
        if topic in _LASTING:
            self._said[topic] = (body, stamp_ns)
        channel.log(body, log_time=stamp_ns)

    @override
    def welcome(self) -> None:
        while self._came:
            topic = self._came.popleft()
            if topic in self._said:
                body, stamp_ns = self._said[topic]
                self._channels[topic].log(body, log_time=stamp_ns)

    @override
    def close(self) -> None:
        self._server.stop()

    def _channel(self, topic: str, kind: MessageType) -> Channel:
        schema = Schema(name=kind.name, encoding="ros2msg", data=kind.definition.encode())
        return Channel(topic, schema=schema, message_encoding="cdr", context=self._context)

    def _encoder(self, kind: MessageType) -> _Encoder:
        if kind.name not in self._encoders:
            # What the writer of recordings encodes by.
            made = mcap_ros2.writer.serialize_dynamic(*kind)  # type: ignore[attr-defined]
            self._encoders[kind.name] = made[kind.name]
        return self._encoders[kind.name]


@final
class _Arrivals(ServerListener):
    """Notes, on the server's threads, which topics somebody begins to listen to.

    Args:
        came: Gets them.
    """

    def __init__(self, came: deque[str]) -> None:
        self._came = came

    @override
    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._came.append(channel.topic)
