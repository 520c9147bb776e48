"""The adapter over zenoh: one router in the middle, every other process a client of it.

Peers behind one hub never hear each other, so there are none. A question is a query with a payload,
answered or reported as lost; a broadcast is a put that drops what a slow receiver cannot take.
Everything is received through bounded rings and polled: no Python runs on zenoh's threads, and a
busy service never stalls its link.
"""

from __future__ import annotations

import logging
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import final

import zenoh
from typing_extensions import override
from zenoh.handlers import FifoChannel, Handler, RingChannel

from gfm.core import ConfigError, GfmError, UnreachableError, WireError
from gfm.transport.bodies import LONGEST_REASON, QUEUED_REQUESTS, Bodies
from gfm.transport.credentials import Credentials
from gfm.transport.endpoints import check_endpoints, host_and_port
from gfm.transport.patience import BoundedLinks
from gfm.transport.port import PendingReply, Request, Server, Subscription, Transport
from gfm.transport.replies import BodyReply
from gfm.transport.sessions import connected_session, listening_session
from gfm_wire import Message, Refusal

_log = logging.getLogger(__name__)

_RUN = re.compile(r"[A-Za-z0-9._-]{1,64}")
_CLOSE_S = 3.0


@final
class ZenohTransport(Transport):
    """One zenoh session, as the run's router or as a client of it."""

    def __init__(
        self,
        session: zenoh.Session,
        run: str,
        name: str,
        *,
        bound_links: Callable[[], None] = lambda: None,
        close_s: float = _CLOSE_S,
    ) -> None:
        """Takes over a session.

        Args:
            session: As a router or a client.
            run: The run's name.
            name: Who sends.
            bound_links: Called before anything is sent, to look after links that are new.
            close_s: How long closing may take.
        """
        self._session = session
        self._bound_links = bound_links
        self._close_s = close_s
        self._prefix = f"gfm/{run}/"
        self._bodies = Bodies(name, time.time_ns())
        # zenoh ends a subscription that nobody holds.
        self._ends: list[object] = []
        self.rejected = self._bodies.rejected

    @classmethod
    def open(
        cls,
        *,
        run: str,
        name: str = "",
        listen: Sequence[str] = (),
        connect: Sequence[str] = (),
        timeout_s: float = 10.0,
        credentials: Credentials | None = None,
        insecure: bool = False,
    ) -> ZenohTransport:
        """Returns a connection: a router where `listen` is given, else a client of `connect`.

        Args:
            run: Keys are prefixed with `gfm/<run>/`; runs that share a router don't meet.
            name: Who sends; stamped on every message.
            listen: Endpoints such as `tcp/127.0.0.1:7447`.
            connect: Endpoints of the router, the first that answers is taken.
            timeout_s: How long to wait for the router.
            credentials: With them every link is by TLS, both sides verify each other, and a router
                lets nobody say or hear but what `gfm_wire.CHANNELS` allows. None: anybody may.
            insecure: Whether a router may listen without credentials.

        Raises:
            ConfigError: an endpoint or the run's name is malformed, there is no endpoint, or one
                lets anybody in.
            BadInputError: an address to listen on is not free, or the two sides of a link do not
                believe each other.
            UnreachableError: no router answered in time.
        """
        if not _RUN.fullmatch(run):
            raise ConfigError(f"run {run!r}: expected 1 to 64 letters, digits, dots, dashes or _")
        check_endpoints(listen, connect, secure=credentials is not None, insecure=insecure)
        session = (
            listening_session(listen, connect, credentials)
            if listen
            else connected_session(connect, credentials, timeout_s=timeout_s)
        )
        ports = [host_and_port(endpoint)[1] for endpoint in (*listen, *connect)]
        return cls(session, run, name, bound_links=BoundedLinks(session, ports).look)

    def connected(self) -> Counter[str]:
        """Returns how many links this router has, by the role of the other side's certificate."""
        roles = (link.auth_identifier for link in self._session.info.links())
        return Counter(role for role in roles if role is not None)

    @override
    def publish(self, key: str, message: Message) -> None:
        body = self._bodies.encode(key, message)
        self._bound_links()
        try:
            self._session.put(
                self._prefix + key, body, congestion_control=zenoh.CongestionControl.BLOCK_FIRST
            )
        except zenoh.ZError as exc:
            raise UnreachableError(key, 0.0) from exc

    @override
    def subscribe(self, key: str, *, keep: int = 1) -> Subscription:
        end = self._session.declare_subscriber(self._prefix + key, RingChannel(keep))
        self._ends.append(end)
        return _ZenohSubscription(key, end, self._bodies)

    @override
    def request(
        self, key: str, message: Message, *, timeout_s: float, everybody: bool = False
    ) -> PendingReply:
        target = zenoh.QueryTarget.ALL if everybody else zenoh.QueryTarget.BEST_MATCHING
        replies = self._ask(key, message, timeout_s, target)
        return _ZenohReply(key, replies, self._bodies)

    @override
    def survey(self, key: str, message: Message, *, timeout_s: float) -> list[Message]:
        answers = []
        for reply in self._ask(key, message, timeout_s, zenoh.QueryTarget.ALL):
            try:
                answers.append(self._bodies.answer(key, _body(key, reply, timeout_s))[0])
            except GfmError as error:
                _log.debug("no answer in a survey of %s: %s", key, error)
        return answers

    def _ask(
        self, key: str, message: Message, timeout_s: float, target: zenoh.QueryTarget
    ) -> Handler[zenoh.Reply]:
        body = self._bodies.encode(key, message)
        self._bound_links()
        try:
            return self._session.get(
                self._prefix + key,
                FifoChannel(QUEUED_REQUESTS),
                payload=body,
                timeout=timeout_s,
                target=target,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        except zenoh.ZError as exc:
            raise UnreachableError(key, 0.0) from exc

    @override
    def serve(self, key: str) -> Server:
        end = self._session.declare_queryable(self._prefix + key, RingChannel(QUEUED_REQUESTS))
        self._ends.append(end)
        return _ZenohServer(key, self._prefix + key, end, self._bodies, self._bound_links)

    @override
    def close(self) -> None:
        self._ends.clear()
        # A session whose router is gone may be looking up its name, and zenoh's close waits for
        # that: in a container network up to 20 s, longer than a service is given to stop.
        closing = threading.Thread(target=self._session.close, name="zenoh-close", daemon=True)
        closing.start()
        closing.join(self._close_s)
        if closing.is_alive():
            _log.warning("left without closing the connection: not closed in %g s", self._close_s)


@final
class _ZenohSubscription(Subscription):
    def __init__(
        self, key: str, end: zenoh.Subscriber[Handler[zenoh.Sample]], bodies: Bodies
    ) -> None:
        self._key = key
        self._end = end
        self._bodies = bodies

    @override
    def take(self) -> Message | None:
        while (sample := self._end.try_recv()) is not None:
            try:
                message, self.stamp = self._bodies.decode_stamped(
                    self._key, sample.payload.to_bytes()
                )
            except WireError:
                continue
            return message
        return None


@final
class _ZenohReply(BodyReply):
    def __init__(self, key: str, replies: Handler[zenoh.Reply], bodies: Bodies) -> None:
        super().__init__(key, bodies)
        self._replies = replies
        self._asked_s = time.monotonic()

    @override
    def _next(self) -> bytes | None:
        waited_s = time.monotonic() - self._asked_s
        try:
            reply = self._replies.try_recv()
        except zenoh.ZError as exc:  # closed without an answer: nobody serves the key
            raise UnreachableError(self._key, waited_s) from exc
        return None if reply is None else _body(self._key, reply, waited_s)


def _body(key: str, reply: zenoh.Reply, waited_s: float) -> bytes:
    if reply.ok is not None:
        return reply.ok.payload.to_bytes()
    payload = b"" if reply.err is None else reply.err.payload.to_bytes()
    if payload == b"Timeout":  # zenoh's own words, where no answer came in time
        raise UnreachableError(key, waited_s)
    return payload


@final
class _ZenohRequest(Request):
    def __init__(self, key: str, query: zenoh.Query, bodies: Bodies) -> None:
        self._key = key
        self._query = query
        self._bodies = bodies

    @override
    def reply(self, message: Message) -> None:
        try:
            body = self._bodies.encode(self._key, message)
        except WireError as error:
            self.refuse(str(error))
            return
        with self._ending() as query:
            query.reply(self._key, body)

    @override
    def refuse(self, reason: str) -> None:
        body = self._bodies.encode(self._key, Refusal(reason=reason[:LONGEST_REASON]))
        with self._ending() as query:
            query.reply_err(body)

    @contextmanager
    def _ending(self) -> Iterator[zenoh.Query]:
        """Ends the query for the asker; one who has left is no error of ours."""
        try:
            with self._query as query:
                yield query
        except zenoh.ZError as error:
            _log.info("nobody waits any more for an answer under %s: %s", self._key, error)


@final
class _ZenohServer(Server):
    def __init__(
        self,
        key: str,
        full_key: str,
        end: zenoh.Queryable[Handler[zenoh.Query]],
        bodies: Bodies,
        bound_links: Callable[[], None],
    ) -> None:
        self._key = key
        self._full_key = full_key
        self._end = end
        self._bodies = bodies
        self._bound_links = bound_links

    @override
    def receive(self) -> Request | None:
        self._bound_links()
        while (query := self._end.try_recv()) is not None:
            request = _ZenohRequest(self._full_key, query, self._bodies)
            try:
                body = b"" if query.payload is None else query.payload.to_bytes()
                request.message, request.stamp = self._bodies.decode_stamped(self._key, body)
            except WireError as error:
                request.refuse(str(error))
                continue
            return request
        return None
