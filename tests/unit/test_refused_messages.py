"""What was refused is counted by reason and sender, whoever tries to make the status grow."""

import pytest

from gfm.core import ManualClock, RefusedError
from gfm.service.question import Question
from gfm.service.refusals import Refusals
from gfm.transport import MemoryHub, MemoryTransport
from gfm_wire import Ack, StatusRequest


def test_refusals_are_counted_by_reason_and_by_sender():
    refusals = Refusals()
    refusals.add("range", "actor-1", "reward reaches 1e30")
    refusals.add("range", "actor-2", "reward reaches 1e30")
    refusals.add("spec", "actor-1", "another digest")
    assert refusals.note == "refused a message of actor-1: another digest"
    assert refusals.counters == {
        "rejected_messages": 3,
        "refused_range": 2,
        "refused_spec": 1,
        "refused_from_actor-1": 2,
        "refused_from_actor-2": 1,
    }


def test_strangers_with_ever_new_names_are_counted_together():
    refusals = Refusals()
    for number in range(1000):
        refusals.add("range", f"{number}/\n" + "x" * 5000, "no")
    counters = refusals.counters
    assert len(counters) < 40
    assert counters["refused_from_others"] == 1000 - 32
    assert max(map(len, counters)) < 100
    assert all("\n" not in name for name in counters)


def test_a_flood_does_not_fill_the_log(caplog):
    refusals = Refusals()
    for _ in range(150):
        refusals.add("range", "a", "no")
    assert [line.rsplit("(", 1)[1] for line in caplog.messages] == [
        "range, 1 so far)",
        "range, 10 so far)",
        "range, 100 so far)",
    ]


class Asked:
    """A question, and somebody who may answer."""

    def __init__(self):
        hub, self.clock = MemoryHub(), ManualClock(10**9)
        self.server = MemoryTransport(hub, name="peer", clock=self.clock).serve("key")
        asker = MemoryTransport(hub, name="asker", clock=self.clock)
        self.question = Question(asker, self.clock, "key", "peer")

    def poll(self):
        return self.question.poll(StatusRequest())


def test_a_question_is_asked_once_until_it_is_answered_and_after_a_pause_again():
    asked = Asked()
    assert asked.poll() is None
    assert asked.poll() is None
    asked.server.receive().reply(Ack())
    assert asked.server.receive() is None
    answer, stamp = asked.poll()
    assert (answer, stamp.sender) == (Ack(), "peer")
    assert asked.poll() is None
    assert not asked.question.is_under_way
    asked.clock.advance_s(0.3)
    assert asked.poll() is None
    assert asked.question.is_under_way


def test_a_question_that_was_refused_can_be_asked_again():
    asked = Asked()
    asked.poll()
    asked.server.receive().refuse("not now")
    with pytest.raises(RefusedError, match="not now"):
        asked.poll()
    asked.clock.advance_s(0.3)
    asked.poll()
    asked.server.receive().reply(Ack())
    assert asked.poll()[0] == Ack()
