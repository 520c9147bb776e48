"""The line to a rosbridge over a websocket: in order, in time, and never again once it broke."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest

pytest.importorskip("websockets")

from websockets.sync.client import connect

from gfm.core import ConfigError, MonotonicClock
from gfm_robot_bridge.intera.link import Arrived, Due
from gfm_robot_bridge.intera.websocket_link import WebsocketLink
from gfm_robot_bridge.rosbridge_sawyer.door import Said
from gfm_robot_bridge.rosbridge_sawyer.websocket_door import WebsocketDoor

CLOCK = MonotonicClock()
MS = 1_000_000


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def eventually(poll: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 5.0
    while not poll():
        assert time.monotonic() < deadline_s, "it never came to that"
        time.sleep(0.002)


class Ends:
    """Both ends of a line."""

    def __init__(self) -> None:
        self.port = free_port()
        self.door = WebsocketDoor("127.0.0.1", self.port)
        self.link = WebsocketLink("127.0.0.1", self.port, CLOCK)
        self.said: list[Said] = []
        self.arrived: list[Arrived] = []
        self.link.open()
        eventually(lambda: self.link.is_open)

    def heard(self) -> list[object]:
        while (said := self.door.receive()) is not None:
            self.said.append(said)
        return [None if said.op is None else said.op["k"] for said in self.said]

    def back(self) -> list[object]:
        self.arrived += self.link.receive()
        return [arrived.op.get("k") for arrived in self.arrived]


@pytest.fixture
def ends() -> Iterator[Ends]:
    made = Ends()
    yield made
    made.link.close()
    made.door.close()


def test_what_is_said_arrives_in_order_and_so_does_the_answer(ends: Ends) -> None:
    for k in range(20):
        ends.link.say({"k": k})
    eventually(lambda: ends.heard() == list(range(20)))
    before_ns = CLOCK.now_ns()
    for k in range(20):
        ends.door.send(ends.said[0].client, {"k": k})
    eventually(lambda: ends.back() == list(range(20)))
    assert all(before_ns <= arrived.at_ns <= CLOCK.now_ns() for arrived in ends.arrived)


def test_a_plan_is_sent_in_its_time_and_a_new_one_replaces_it(ends: Ends) -> None:
    now_ns = CLOCK.now_ns()
    ends.link.plan([Due(op={"k": 0}, at_ns=now_ns), Due(op={"k": 1}, at_ns=now_ns + 10**12)])
    eventually(lambda: ends.heard() == [0])
    ends.link.plan([Due(op={"k": 2}, at_ns=now_ns)])
    eventually(lambda: ends.heard() == [0, 2])


def test_what_is_worthless_by_now_is_not_sent(ends: Ends) -> None:
    now_ns = CLOCK.now_ns()
    late = Due(op={"k": 0}, at_ns=now_ns - 20 * MS, until_ns=now_ns - 10 * MS)
    ends.link.plan([late, Due(op={"k": 1}, at_ns=now_ns)])
    eventually(lambda: ends.heard() == [1])


def test_closing_sends_what_is_planned(ends: Ends) -> None:
    now_ns = CLOCK.now_ns()
    ends.link.plan([Due(op={"k": k}, at_ns=now_ns + k * 4 * MS) for k in range(10)])
    ends.link.close()
    assert not ends.link.is_open
    eventually(lambda: ends.heard() == [*range(10), None])


def test_a_line_that_broke_says_why_and_stays_so(ends: Ends) -> None:
    ends.link.plan([Due(op={"k": 0}, at_ns=CLOCK.now_ns() + 10**12)])
    ends.door.close()
    eventually(lambda: ends.link.problem)
    ends.link.say({"k": 1})
    assert not ends.link.is_open
    ends.door = WebsocketDoor("127.0.0.1", ends.port)
    assert not ends.link.is_open
    ends.link.open()
    eventually(lambda: ends.link.is_open)
    ends.link.say({"k": 2})
    # Nothing that was said or planned before it broke comes after it.
    eventually(lambda: ends.heard()[-1:] == [2])
    assert 0 not in ends.heard()
    assert 1 not in ends.heard()


def test_dropping_it_keeps_the_first_reason(ends: Ends) -> None:
    ends.link.drop("nothing was heard")
    ends.link.drop("something else")
    assert ends.link.problem == "nothing was heard"
    eventually(lambda: ends.heard() == [None])


def test_what_is_no_json_object_is_passed_on_as_that(ends: Ends) -> None:
    with connect(f"ws://127.0.0.1:{ends.port}") as line:
        line.send("[1, 2")
        eventually(lambda: (said := ends.door.receive()) and "no JSON object" in said.op["op"])


def test_nobody_there_is_said() -> None:
    link = WebsocketLink("127.0.0.1", free_port(), CLOCK)
    link.open()
    eventually(lambda: "refused" in link.problem)
    assert not link.is_open


def test_somebody_who_is_no_rosbridge_is_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        link = WebsocketLink("127.0.0.1", other.getsockname()[1], CLOCK)
        link.open()
        near, _ = other.accept()
        with near:
            near.recv(1000)
            near.sendall(b"HTTP/1.1 404 Not Found\r\n\r\n")
        eventually(lambda: "404" in link.problem)


def test_a_port_in_use_is_refused(ends: Ends) -> None:
    with pytest.raises(ConfigError, match=rf"ros is 127\.0\.0\.1:{ends.port}: .* a free port"):
        WebsocketDoor("127.0.0.1", ends.port)


def test_setpoints_do_not_pile_up_before_a_peer_that_takes_nothing() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        release, taken = threading.Event(), []

        def serve() -> None:
            near, _ = listener.accept()
            near.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            with near:
                near.sendall(_handshake(near.recv(4096)))
                release.wait()
                near.settimeout(0.5)
                with suppress(OSError):  # nothing more comes, or the line was given up
                    while data := near.recv(1 << 16):
                        taken.append(data)

        peer = threading.Thread(target=serve)
        peer.start()
        link = WebsocketLink("127.0.0.1", listener.getsockname()[1], CLOCK)
        link.open()
        eventually(lambda: link.is_open)
        ballast = "x" * 2000
        for k in range(2000):
            link.plan([Due(op={"k": k, "ballast": ballast}, at_ns=CLOCK.now_ns())])
            time.sleep(2e-4)
        release.set()
        peer.join()
        link.close()
    received = sum(len(data) for data in taken)
    assert received < 2000 * len(ballast) / 4


def _handshake(request: bytes) -> bytes:
    from websockets.utils import accept_key

    lines = request.decode().split("\r\n")
    key = next(line.partition(": ")[2] for line in lines if line.startswith("Sec-WebSocket-Key"))
    return (
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Accept: {accept_key(key)}\r\n\r\n"
    ).encode()
