"""One suite for the transport port, run over both adapters."""

from __future__ import annotations

import gc
import socket
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from threading import Event, Thread
from typing import cast

import pytest

from gfm.core import BadInputError, ConfigError, RefusedError, Status, UnreachableError
from gfm.transport import (
    MemoryHub,
    MemoryTransport,
    PendingReply,
    Request,
    Server,
    Subscription,
    Transport,
)
from gfm.transport.patience import ports_of, tcp_sockets
from gfm.transport.zenoh import ZenohTransport
from gfm_wire import Ack, Message, RecordDone, SampleRequest, StatusRequest

Connect = Callable[[], Transport]


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture(params=["memory", "zenoh"])
def connect(request) -> Iterator[Connect]:
    """Yields a function that opens one more connection; over zenoh the first is the router."""
    opened: list[Transport] = []
    hub, endpoint = MemoryHub(), free_endpoint()

    def opening() -> Transport:
        if request.param == "memory":
            opened.append(MemoryTransport(hub))
        elif opened:
            opened.append(ZenohTransport.open(run="test", connect=[endpoint]))
        else:
            opened.append(ZenohTransport.open(run="test", listen=[endpoint], insecure=True))
        return opened[-1]

    yield opening
    for transport in reversed(opened):
        transport.close()


def eventually(poll: Callable[[], object | None]) -> object:
    """Returns what `poll` returns as soon as it is not None; fails after five seconds."""
    deadline_s = time.monotonic() + 5.0
    while (value := poll()) is None:
        assert time.monotonic() < deadline_s, "nothing arrived"
    return value


def broadcast(publisher: Transport, arrived: Subscription, message: Message) -> None:
    """Publishes under `weights` until it arrives: on a busy machine a broadcast may be dropped."""

    def again() -> bool | None:
        publisher.publish("weights", message)
        time.sleep(0.01)
        return arrived.latest() == message or None

    eventually(again)


def received(server: Server) -> Request:
    request = eventually(server.receive)
    assert isinstance(request, Request)
    return request


def asked(server: Server, ask: Callable[[], PendingReply]) -> tuple[PendingReply, Request]:
    """Asks until it is received: the hub may not know yet what another client serves."""

    def again() -> tuple[PendingReply, Request] | None:
        pending = ask()
        with suppress(UnreachableError):
            while pending.poll() is None:
                if request := server.receive():
                    return pending, request
        return None

    return cast("tuple[PendingReply, Request]", eventually(again))


def answer(pending: PendingReply) -> Message:
    return eventually(pending.poll)


def test_an_answer_reaches_the_asker_and_stays_available(connect):
    server = connect().serve("robot/record")
    pending = connect().request("robot/record", StatusRequest(), timeout_s=5.0)
    request = received(server)
    assert request.message == StatusRequest()
    request.reply(RecordDone(path="a.mcap", ticks=3))
    assert answer(pending) == RecordDone(path="a.mcap", ticks=3)
    assert pending.poll() == RecordDone(path="a.mcap", ticks=3)


def asked_in_vain(client: Transport, server: Server) -> weakref.ref[PendingReply]:
    """Returns what still holds a question that was refused, and looked at twice."""
    pending = client.request("replay/sample", SampleRequest(batch_size=4), timeout_s=5.0)
    received(server).refuse("no")
    for _ in range(2):
        with suppress(RefusedError):
            answer(pending)
    return weakref.ref(pending)


def test_a_question_in_vain_waits_for_no_collector(connect):
    server = connect().serve("replay/sample")
    client = connect()
    gc.disable()
    try:
        assert asked_in_vain(client, server)() is None
    finally:
        gc.enable()


def test_a_client_can_ask_a_client_through_the_hub(connect):
    connect()
    server, asker = connect().serve("weights/current"), connect()
    ask = partial(asker.request, "weights/current", StatusRequest(), timeout_s=5.0)
    pending, request = asked(server, ask)
    request.reply(Ack())
    assert answer(pending) == Ack()


def test_a_refusal_is_raised_at_the_asker_with_its_reason(connect):
    server = connect().serve("replay/sample")
    pending = connect().request("replay/sample", SampleRequest(batch_size=4), timeout_s=5.0)
    received(server).refuse("spec_digest is a, expected b")
    for _ in range(2):
        with pytest.raises(RefusedError, match="spec_digest is a, expected b"):
            answer(pending)


def test_asking_where_nobody_serves_is_unreachable_at_once(connect):
    pending = connect().request("nobody", StatusRequest(), timeout_s=60.0)
    with pytest.raises(UnreachableError, match="no answer from nobody"):
        answer(pending)


def test_asking_whoever_does_not_answer_is_unreachable_after_the_deadline(connect):
    server = connect().serve("slow")
    pending = connect().request("slow", StatusRequest(), timeout_s=0.1)
    kept = received(server)
    with pytest.raises(UnreachableError, match="no answer from slow"):
        answer(pending)
    assert kept.message == StatusRequest()


def test_everybody_is_asked_and_a_rejected_answer_makes_room_for_the_next(connect):
    connect()
    servers = [connect().serve("replay/insert") for _ in range(2)]
    asker = connect()

    def ask_both() -> tuple[PendingReply, list[Request]] | None:
        # A client learns of a second server a moment after the first.
        pending = asker.request("replay/insert", StatusRequest(), timeout_s=5.0, everybody=True)
        first, second = received(servers[0]), None
        deadline_s = time.monotonic() + 0.2
        while second is None and time.monotonic() < deadline_s:
            second = servers[1].receive()
        return None if second is None else (pending, [first, second])

    pending, requests = eventually(ask_both)
    for ticks, request in enumerate(requests):
        request.reply(RecordDone(path="", ticks=ticks))
    heard = {answer(pending).ticks}
    pending.reject()
    heard.add(answer(pending).ticks)
    assert heard == {0, 1}
    pending.reject()
    with pytest.raises(UnreachableError):
        answer(pending)


def test_a_refusal_of_one_leaves_the_answer_of_another(connect):
    connect()
    server, asker = connect().serve("replay/insert"), connect()
    ask = partial(asker.request, "replay/insert", StatusRequest(), timeout_s=5.0, everybody=True)
    pending, request = asked(server, ask)
    request.refuse("no")
    with pytest.raises(RefusedError, match="no"):
        answer(pending)
    pending.reject()
    with pytest.raises(UnreachableError):
        answer(pending)


def test_answers_and_broadcasts_tell_who_sent_them(connect):
    hub, other = connect(), connect()
    server = hub.serve("who")
    pending = other.request("who", StatusRequest(), timeout_s=5.0)
    request = received(server)
    request.reply(Ack())
    answer(pending)
    subscription = hub.subscribe("weights", keep=10)
    broadcast(other, subscription, RecordDone(path="", ticks=1))
    assert subscription.stamp.epoch == request.stamp.epoch
    assert pending.stamp.epoch != request.stamp.epoch


def test_questions_are_received_in_the_order_in_which_they_were_asked(connect):
    server, asker = connect().serve("count"), connect()
    pending = [
        asker.request("count", SampleRequest(batch_size=n + 1), timeout_s=5.0) for n in range(20)
    ]
    sizes = []
    for _ in pending:
        request = received(server)
        sizes.append(request.message.batch_size)
        request.reply(Ack())
    assert sizes == list(range(1, 21))
    assert all(answer(one) == Ack() for one in pending)


def test_a_body_that_the_server_cannot_read_is_refused_counted_and_does_not_stop_it(connect):
    serving, asking = connect(), connect()
    server = serving.serve("replay/insert")
    bad = asking.request("replay/insert", SampleRequest(batch_size=-1), timeout_s=5.0)
    good = asking.request("replay/insert", StatusRequest(), timeout_s=5.0)
    received(server).reply(Ack())
    assert answer(good) == Ack()
    with pytest.raises(RefusedError, match=r"range: SampleRequest\.batch_size is -1"):
        answer(bad)
    assert serving.rejected == {"range": 1}
    assert not asking.rejected


def test_an_answer_that_the_asker_cannot_read_is_refused_and_counted_there(connect):
    serving, asking = connect(), connect()
    server = serving.serve("replay/sample")
    pending = asking.request("replay/sample", StatusRequest(), timeout_s=5.0)
    received(server).reply(SampleRequest(batch_size=-1))
    with pytest.raises(RefusedError, match="cannot be understood"):
        answer(pending)
    assert asking.rejected == {"range": 1}


def test_an_answer_that_is_too_large_becomes_a_refusal(connect):
    server = connect().serve("robot/record")
    pending = connect().request("robot/record", StatusRequest(), timeout_s=5.0)
    received(server).reply(RecordDone(path="x" * 70_000_000, ticks=1))
    with pytest.raises(RefusedError, match="too_large"):
        answer(pending)


def test_a_subscription_keeps_the_newest(connect):
    hub, publisher = connect(), connect()
    newest, barrier = hub.subscribe("weights", keep=1), hub.serve("barrier")
    several, arrived = hub.subscribe("weights", keep=100), hub.subscribe("weights", keep=100)
    for ticks in range(10):
        broadcast(publisher, arrived, RecordDone(path="", ticks=ticks))
    pending = publisher.request("barrier", StatusRequest(), timeout_s=5.0)
    received(barrier).reply(Ack())
    answer(pending)
    assert newest.take() == RecordDone(path="", ticks=9)
    assert newest.take() is None
    assert several.take() == RecordDone(path="", ticks=0)
    assert several.latest() == RecordDone(path="", ticks=9)
    assert several.latest() is None


def test_published_bodies_that_are_refused_are_counted_and_skipped(connect):
    hub, publisher = connect(), connect()
    subscription = hub.subscribe("weights", keep=10)
    publisher.publish("weights", RecordDone(path="", ticks=-1))
    eventually(lambda: subscription.take() or hub.rejected or None)
    publisher.publish("weights", RecordDone(path="", ticks=1))
    assert eventually(subscription.take) == RecordDone(path="", ticks=1)
    assert hub.rejected == {"range": 1}


def test_a_late_joiner_hears_nothing_old_but_everything_new(connect):
    hub, publisher = connect(), connect()
    early = hub.subscribe("weights", keep=10)
    publisher.publish("weights", RecordDone(path="", ticks=1))
    eventually(early.take)
    late = connect().subscribe("weights", keep=10)

    def heard() -> object | None:  # a subscription takes a moment to reach the publisher
        publisher.publish("weights", RecordDone(path="", ticks=2))
        return late.take()

    assert eventually(heard) == RecordDone(path="", ticks=2)


def test_a_survey_hears_everybody_whose_key_matches(connect):
    hub = connect()
    names = ["actor/one", "actor/two", "replay/one"]
    servers = [connect().serve(f"status/{name}") for name in names]
    other = connect().serve("status/too/many/parts")
    asker = connect()
    for name, server in zip(names, servers, strict=True):  # until the hub knows of each
        ask = partial(asker.request, f"status/{name}", StatusRequest(), timeout_s=5.0)
        pending, request = asked(server, ask)
        request.reply(Ack())
        answer(pending)
    answers: list[list[Message]] = []
    thread = Thread(
        target=lambda: answers.append(asker.survey("status/*/*", StatusRequest(), timeout_s=5.0))
    )
    thread.start()
    for name, server in zip(names, servers, strict=True):
        role, _, rest = name.partition("/")
        received(server).reply(Status(role=role, name=rest, pid=1, host="h"))
    thread.join()
    heard = sorted(f"{status.role}/{status.name}" for status in answers[0])
    assert heard == names
    assert other.receive() is None
    assert not hub.rejected


def test_a_survey_of_nobody_is_empty(connect):
    assert connect().survey("status/*/*", StatusRequest(), timeout_s=0.5) == []


def test_what_waits_for_a_connection_that_closes_is_unreachable(connect):
    hub = connect()
    serving = connect()
    serving.serve("robot/command")
    pending = hub.request("robot/command", StatusRequest(), timeout_s=60.0)
    serving.close()
    with pytest.raises(UnreachableError, match="robot/command"):
        answer(pending)

    def gone() -> object | None:
        try:
            return hub.request("robot/command", StatusRequest(), timeout_s=60.0).poll()
        except UnreachableError:
            return True

    assert eventually(gone)


def test_zenoh_refuses_an_address_that_is_taken_in_one_line():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(BadInputError, match="address already in use") as caught:
            ZenohTransport.open(run="test", listen=[endpoint], insecure=True)
    assert endpoint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_zenoh_gives_up_on_an_absent_router_after_the_deadline():
    endpoint = free_endpoint()
    with pytest.raises(UnreachableError, match=f"a router at {endpoint} within 0.1 s"):
        ZenohTransport.open(run="test", connect=[endpoint], timeout_s=0.1)


def test_zenoh_waits_for_a_router_that_comes_later():
    endpoint = free_endpoint()
    opened: list[Transport] = []
    thread = Thread(
        target=lambda: opened.append(
            ZenohTransport.open(run="test", connect=[endpoint], timeout_s=10.0)
        )
    )
    thread.start()
    with ZenohTransport.open(run="test", listen=[endpoint], insecure=True) as hub:
        thread.join()
        with opened[0] as client:
            server = hub.serve("hello")
            pending = client.request("hello", StatusRequest(), timeout_s=5.0)
            received(server).reply(Ack())
            assert answer(pending) == Ack()


def test_a_body_larger_than_any_message_of_its_key_is_read_by_nobody_and_stops_nobody(connect):
    server_side, client = connect(), connect()
    server = server_side.serve("replay/sample")
    pending = client.request("replay/sample", SampleRequest(batch_size=1), timeout_s=5.0)
    received(server).reply(Ack())
    assert answer(pending) == Ack()
    if isinstance(client, MemoryTransport):
        client._hub.tamper = lambda _key, body: body + bytes(64 * 2**20)
    else:
        client._bodies.encode = lambda _key, _message: bytes(64 * 2**20 + 1)
    sent = client.request("replay/sample", SampleRequest(batch_size=1), timeout_s=1.0)
    with pytest.raises((UnreachableError, RefusedError)):
        eventually(lambda: server.receive() or sent.poll())
    if isinstance(client, MemoryTransport):
        assert server_side.rejected == {"too_large": 1}


def test_zenoh_s_router_passes_on_no_body_that_is_too_large_for_its_key():
    endpoint = free_endpoint()
    with (
        ZenohTransport.open(run="one", listen=[endpoint], insecure=True),
        ZenohTransport.open(run="one", connect=[endpoint]) as server_side,
        ZenohTransport.open(run="one", connect=[endpoint]) as client,
    ):
        server = server_side.serve("robot/command")
        eventually(lambda: _is_heard(client, server))
        client._bodies.encode = lambda _key, _message: bytes(256 * 1024 + 1)
        pending = client.request("robot/command", StatusRequest(), timeout_s=1.0)
        with pytest.raises(UnreachableError):
            answer(pending)
        assert server.receive() is None
        assert server_side.rejected == {}


def _is_heard(client: Transport, server: Server) -> Request | None:
    client.request("robot/command", StatusRequest(), timeout_s=1.0)
    time.sleep(0.01)
    return server.receive()


def test_runs_that_share_a_router_do_not_meet():
    endpoint = free_endpoint()
    with (
        ZenohTransport.open(run="one", listen=[endpoint], insecure=True) as one,
        ZenohTransport.open(run="two", connect=[endpoint]) as two,
    ):
        one.serve("hello")
        with pytest.raises(UnreachableError):
            answer(two.request("hello", StatusRequest(), timeout_s=5.0))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"run": "a/b", "listen": ["tcp/127.0.0.1:1"]}, "run 'a/b': expected"),
        ({"run": "a"}, "no endpoint"),
        ({"run": "a", "connect": ["127.0.0.1:1"]}, "expected tcp/HOST:PORT"),
        ({"run": "a", "connect": ["tcp/127.0.0.1"]}, "expected tcp/HOST:PORT"),
    ],
)
def test_zenoh_refuses_malformed_settings(settings, message):
    with pytest.raises(ConfigError, match=message):
        ZenohTransport.open(**settings)


def test_zenoh_leaves_a_session_that_does_not_close(caplog):
    class StuckSession:
        def __init__(self):
            self.freed = Event()

        def close(self):
            self.freed.wait()

    session = StuckSession()
    ZenohTransport(session, "run", "name", close_s=0.01).close()
    session.freed.set()
    assert "not closed in 0.01 s" in caplog.text


def test_a_memory_hub_can_lose_and_damage_bodies():
    hub = MemoryHub()
    serving, asking = MemoryTransport(hub), MemoryTransport(hub)
    server = serving.serve("replay/insert")
    hub.tamper = lambda _key, _body: None
    lost = asking.request("replay/insert", StatusRequest(), timeout_s=0.0)
    with pytest.raises(UnreachableError):
        lost.poll()
    assert server.receive() is None
    hub.tamper = lambda _key, body: body[:-1]
    damaged = asking.request("replay/insert", StatusRequest(), timeout_s=5.0)
    assert server.receive() is None
    with pytest.raises(RefusedError, match="not_msgpack"):
        damaged.poll()
    assert serving.rejected == {"not_msgpack": 1}


def bounds_ms(port: int) -> list[int]:
    """Returns after how long the kernel ends connections from or to a port that are stuck."""
    found = []
    for connection in tcp_sockets():
        with connection, suppress(OSError):
            if port in ports_of(connection):
                found.append(connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT))
    return found


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="no such bound on this system")
def test_the_kernel_gives_up_on_stuck_connections_of_zenoh_before_zenoh_does():
    endpoint = free_endpoint()
    port = int(endpoint.rpartition(":")[2])
    with ZenohTransport.open(run="test", listen=[endpoint], insecure=True):
        client = ZenohTransport.open(run="test", connect=[endpoint])
        server = client.serve("replay/insert")
        # The one that listens, and both ends of the link; where zenoh just connects again, more.
        eventually(lambda: (server.receive(), len(bounds_ms(port)) >= 3)[1] or None)
        assert set(bounds_ms(port)) == {2000}
    with client, ZenohTransport.open(run="test", listen=[endpoint], insecure=True):
        eventually(lambda: (server.receive(), len(bounds_ms(port)) >= 3)[1] or None)
        eventually(lambda: (server.receive(), set(bounds_ms(port)) == {2000})[1] or None)
