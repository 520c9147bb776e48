"""The adapter without a network: several connections of one process share a hub.

Bodies are encoded and decoded as on the wire, so that the same ones are refused.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import final

from typing_extensions import override

from gfm.core import Clock, GfmError, MonotonicClock, UnreachableError, WireError
from gfm.transport.bodies import LONGEST_REASON, QUEUED_REQUESTS, Bodies
from gfm.transport.port import PendingReply, Request, Server, Subscription, Transport
from gfm.transport.replies import BodyReply
from gfm_wire import Message, Refusal

_POLL_NS = 1_000_000


def key_matches(pattern: str, key: str) -> bool:
    """Returns whether `key` has the parts of `pattern`, where `*` stands for any one part."""
    parts, wanted = key.split("/"), pattern.split("/")
    return len(parts) == len(wanted) and all(
        want in ("*", part) for want, part in zip(wanted, parts, strict=True)
    )


def _untouched(_key: str, body: bytes) -> bytes | None:
    return body


@final
class MemoryHub:
    """Where the connections of one process meet.

    Attributes:
        tamper: What becomes of a body under a key, for tests of faults: the body itself, another
            one, or None where it is lost. Answers pass through it, too.
    """

    def __init__(self) -> None:
        self.tamper: Callable[[str, bytes], bytes | None] = _untouched
        self._subscriptions: list[_MemorySubscription] = []
        self._servers: list[_MemoryServer] = []
        self._epoch = -1

    def new_epoch(self, utc_ns: int) -> int:
        """Returns when a connection begins: now, and later than every earlier one."""
        self._epoch = max(utc_ns, self._epoch + 1)
        return self._epoch

    def add(self, end: _MemorySubscription | _MemoryServer) -> None:
        """Connects a receiver."""
        if isinstance(end, _MemoryServer):
            self._servers.append(end)
        else:
            self._subscriptions.append(end)

    def remove(self, bodies: Bodies) -> None:
        """Disconnects every receiver of one connection; who still waits for it is told."""
        for server in self._servers:
            if server.bodies is bodies:
                server.abandon()
        self._servers = [end for end in self._servers if end.bodies is not bodies]
        self._subscriptions = [end for end in self._subscriptions if end.bodies is not bodies]

    def publish(self, key: str, body: bytes) -> None:
        """Hands a body to every subscription of `key`."""
        arriving = self.tamper(key, body)
        for subscription in self._subscriptions:
            if arriving is not None and key_matches(subscription.key, key):
                subscription.kept.append(arriving)

    def servers(self, pattern: str) -> list[_MemoryServer]:
        """Returns who serves a key that matches."""
        return [server for server in self._servers if key_matches(pattern, server.key)]

    def ask(self, server: _MemoryServer, body: bytes, pending: _MemoryReply) -> None:
        """Hands a question to a server."""
        arriving = self.tamper(server.key, body)
        if arriving is not None:
            server.enqueue(_MemoryRequest(arriving, server, pending))


@final
class MemoryTransport(Transport):
    """One connection to a hub."""

    def __init__(self, hub: MemoryHub, *, name: str = "memory", clock: Clock | None = None) -> None:
        self._hub = hub
        self._clock = clock or MonotonicClock()
        self._bodies = Bodies(name, hub.new_epoch(self._clock.utc_ns()))
        self.rejected = self._bodies.rejected

    @override
    def publish(self, key: str, message: Message) -> None:
        self._hub.publish(key, self._bodies.encode(key, message))

    @override
    def subscribe(self, key: str, *, keep: int = 1) -> Subscription:
        subscription = _MemorySubscription(key, keep, self._bodies)
        self._hub.add(subscription)
        return subscription

    @override
    def request(
        self, key: str, message: Message, *, timeout_s: float, everybody: bool = False
    ) -> PendingReply:
        body = self._bodies.encode(key, message)
        servers = self._hub.servers(key)
        asked = servers if everybody else servers[:1]
        pending = _MemoryReply(key, timeout_s, self._clock, self._bodies, asked=len(asked))
        for server in asked:
            self._hub.ask(server, body, pending)
        return pending

    @override
    def survey(self, key: str, message: Message, *, timeout_s: float) -> list[Message]:
        body = self._bodies.encode(key, message)
        waiting = []
        for server in self._hub.servers(key):
            pending = _MemoryReply(server.key, timeout_s, self._clock, self._bodies)
            self._hub.ask(server, body, pending)
            waiting.append(pending)
        return [answer for pending in waiting if (answer := self._wait(pending)) is not None]

    def _wait(self, pending: _MemoryReply) -> Message | None:
        try:
            while (answer := pending.poll()) is None:
                self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)
        except GfmError:
            return None
        return answer

    @override
    def serve(self, key: str) -> Server:
        server = _MemoryServer(key, self._hub, self._bodies)
        self._hub.add(server)
        return server

    @override
    def close(self) -> None:
        self._hub.remove(self._bodies)


@final
class _MemorySubscription(Subscription):
    def __init__(self, key: str, keep: int, bodies: Bodies) -> None:
        self.key = key
        self.bodies = bodies
        self.kept: deque[bytes] = deque(maxlen=keep)

    @override
    def take(self) -> Message | None:
        while self.kept:
            try:
                message, self.stamp = self.bodies.decode_stamped(self.key, self.kept.popleft())
            except WireError:
                continue
            return message
        return None


@final
class _MemoryReply(BodyReply):
    def __init__(
        self, key: str, timeout_s: float, clock: Clock, bodies: Bodies, *, asked: int = 1
    ) -> None:
        super().__init__(key, bodies)
        self._clock = clock
        self._asked_ns = clock.now_ns()
        self._deadline_ns = self._asked_ns + round(timeout_s * 1e9)
        self._arrived: deque[bytes] = deque()
        self._waiting = asked

    def answer(self, body: bytes) -> None:
        """Receives an answer, unless it comes too late."""
        self._waiting -= 1
        if self._clock.now_ns() < self._deadline_ns:
            self._arrived.append(body)

    def abandon(self) -> None:
        """Learns that one of those asked will not answer."""
        self._waiting -= 1

    @override
    def _next(self) -> bytes | None:
        if self._arrived:
            return self._arrived.popleft()
        if self._waiting <= 0 or self._clock.now_ns() >= self._deadline_ns:
            raise UnreachableError(self._key, (self._clock.now_ns() - self._asked_ns) * 1e-9)
        return None


@final
class _MemoryRequest(Request):
    def __init__(self, body: bytes, server: _MemoryServer, pending: _MemoryReply) -> None:
        self.body = body
        self.pending = pending
        self._server = server

    @override
    def reply(self, message: Message) -> None:
        try:
            body = self._server.bodies.encode(self._server.key, message)
        except WireError as error:
            self.refuse(str(error))
            return
        arriving = self._server.hub.tamper(self._server.key, body)
        if arriving is not None:
            self.pending.answer(arriving)

    @override
    def refuse(self, reason: str) -> None:
        self.reply(Refusal(reason=reason[:LONGEST_REASON]))


@final
class _MemoryServer(Server):
    def __init__(self, key: str, hub: MemoryHub, bodies: Bodies) -> None:
        self.key = key
        self.hub = hub
        self.bodies = bodies
        self._waiting: deque[_MemoryRequest] = deque()

    def enqueue(self, request: _MemoryRequest) -> None:
        """Adds a question; where too many wait, the oldest is given up."""
        self._waiting.append(request)
        if len(self._waiting) > QUEUED_REQUESTS:
            self._waiting.popleft().pending.abandon()

    def abandon(self) -> None:
        """Gives up every question."""
        while self._waiting:
            self._waiting.popleft().pending.abandon()

    @override
    def receive(self) -> Request | None:
        while self._waiting:
            request = self._waiting.popleft()
            try:
                request.message, request.stamp = self.bodies.decode_stamped(self.key, request.body)
            except WireError as error:
                request.refuse(str(error))
                continue
            return request
        return None
