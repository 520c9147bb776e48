"""Whoever asks much waits behind itself, not before others."""

from __future__ import annotations

import pytest

from gfm.core import ManualClock, RefusedError
from gfm.service import turns
from gfm.service.rates import Rates
from gfm.service.refusals import Refusals
from gfm.service.turns import Turns
from gfm.transport import MemoryHub, MemoryTransport
from gfm_wire import NotReady, StatusRequest


class Room:
    """A server with turns, and those who ask."""

    def __init__(self, longest=4, busy=None, per_s=1e6):
        self.hub, self.clock, self.refusals = MemoryHub(), ManualClock(), Refusals()
        served = MemoryTransport(self.hub, clock=self.clock).serve("key")
        rates = Rates(self.clock, per_s)
        self.server = Turns(served, self.refusals, rates, longest=longest, busy=busy)
        self._askers = {}

    def ask(self, name, times=1):
        asker = self._askers.get(name) or MemoryTransport(self.hub, name=name, clock=self.clock)
        self._askers[name] = asker
        return [asker.request("key", StatusRequest(), timeout_s=5.0) for _ in range(times)]

    def senders(self, count):
        requests = [self.server.receive() for _ in range(count)]
        return "".join(request.stamp.sender if request else "-" for request in requests)


def test_senders_have_turns_and_each_is_heard_in_the_order_in_which_it_asked():
    room = Room()
    room.ask("a", 3)
    room.ask("b", 2)
    room.ask("c")
    found = [room.server.receive() for _ in range(7)]
    assert [one and one.stamp.sender for one in found] == ["a", "b", "c", "a", "b", "a", None]
    assert [one.stamp.number for one in found if one and one.stamp.sender == "a"] == [0, 1, 2]
    assert room.refusals.total == 0


def test_one_who_comes_late_is_next_though_others_have_long_lines():
    room = Room(longest=10)
    room.ask("a", 8)
    assert room.senders(2) == "aa"
    room.ask("b")
    assert room.senders(3) == "aba"


def test_what_is_too_much_is_refused_and_counted_under_its_sender_alone():
    room = Room(longest=2)
    asked = room.ask("a", 5)
    (other,) = room.ask("b")
    assert room.senders(4) == "aba-"
    with pytest.raises(RefusedError, match="2 of its questions wait, expected at most 2"):
        asked[2].poll()
    assert other.poll() is None
    assert dict(room.refusals.counters) == {
        "rejected_messages": 3,
        "refused_queue": 3,
        "refused_from_a": 3,
    }


def test_what_is_too_much_may_be_told_to_come_later():
    later = NotReady(reason="later")
    room = Room(longest=1, busy=later)
    first, second = room.ask("a", 2)
    room.senders(1)
    assert first.poll() is None
    assert second.poll() == later


def test_a_flood_is_read_a_little_at_a_time():
    room = Room(longest=1000)
    room.ask("a", 500)
    room.server.receive()
    room.ask("b")
    before_b = room.senders(50).index("b")
    assert before_b == pytest.approx(500 / turns._READ_AHEAD, abs=2)


def test_all_lines_together_are_bounded_whatever_the_names(monkeypatch):
    monkeypatch.setattr(turns, "_MOST", 4)
    room = Room()
    for number in range(9):
        room.ask(f"stranger-{number}")
    found = [room.server.receive() for _ in range(3)]
    assert [one.stamp.sender for one in found] == [f"stranger-{n}" for n in range(3)]
    assert room.server._waiting == 3  # read up to the bound, and one handed out
    room.ask("late")
    rest = [one.stamp.sender for one in iter(room.server.receive, None)]
    assert rest == [*(f"stranger-{n}" for n in range(3, 9)), "late"]
    assert room.refusals.total == 0


def test_senders_beyond_all_bounds_share_a_line(monkeypatch):
    monkeypatch.setattr(turns, "_SENDERS", 2)
    room = Room(longest=2)
    for name in "abcd":
        room.ask(name, 2)
    assert room.senders(7) == "abcabc-"
    assert room.refusals.counters["refused_from_d"] == 2


def test_who_asks_more_often_than_allowed_is_turned_away_and_counted_alone():
    room = Room(per_s=2.0)
    asked = room.ask("a", 3)
    room.ask("b")
    assert room.senders(4) == "aba-"
    with pytest.raises(
        RefusedError, match="more questions a second than allowed, expected at most 2"
    ):
        asked[2].poll()
    assert dict(room.refusals.counters) == {
        "rejected_messages": 1,
        "refused_rate": 1,
        "refused_from_a": 1,
    }


def test_what_is_left_unused_may_be_asked_later_up_to_a_second_s_worth():
    clock = ManualClock()
    rates = Rates(clock, 4.0)
    assert [rates.take("a") for _ in range(5)] == [True] * 4 + [False]
    clock.advance_s(0.25)
    assert [rates.take("a") for _ in range(2)] == [True, False]
    clock.advance_s(100.0)
    assert [rates.take("a") for _ in range(5)] == [True] * 4 + [False]


def test_at_the_allowed_rate_nobody_is_turned_away():
    clock = ManualClock()
    rates = Rates(clock, 8.0)
    for _ in range(100):
        assert rates.take("a")
        clock.advance_s(0.125)


def test_senders_whose_rates_are_known_are_bounded(monkeypatch):
    monkeypatch.setattr("gfm.service.rates._SENDERS", 3)
    rates = Rates(ManualClock(), 1.0)
    assert all(rates.take(name) for name in "abcd")
    assert not rates.take("d")
    assert rates.take("a")  # it was forgotten
