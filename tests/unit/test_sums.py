"""Counters that go on from process to process, and log lines for programs."""

from __future__ import annotations

import json
import logging
import sys

import pytest

from gfm.core import BadInputError, ManualClock
from gfm.service import RunningService, Service, make_status
from gfm.service.logs import JsonFormatter
from gfm.service.refusals import Refusals
from gfm.service.sums import Sums, make_sums
from gfm.transport import MemoryHub, MemoryTransport


class Counting(Service):
    """Counts its steps, and goes on by itself with what it has kept."""

    def __init__(self, kept=0):
        self.steps, self.kept = 0, kept

    def step(self):
        self.steps += 1
        self.kept += 1
        return True

    def status(self):
        return make_status("actor", "a", counters={"steps": self.steps, "kept": self.kept})

    def lasting(self):
        return frozenset({"kept"})

    def close(self):
        pass


def life(path, clock, steps, kept=0) -> dict[str, int]:
    """Returns what a process says after so many steps of a second each, before it is killed."""
    transport = MemoryTransport(MemoryHub(), name="a", clock=clock)
    running = RunningService(Counting(kept), transport, Sums(path, clock))
    for _ in range(steps):
        clock.advance_s(1.0)
        running.step()
    return dict(running.status().counters)


def test_the_next_process_goes_on_with_what_those_before_counted(tmp_path):
    clock, path = ManualClock(0), tmp_path / "a.sums.json"
    assert life(path, clock, 3) == {"steps": 3, "kept": 3, "rejected_messages": 0}
    assert life(path, clock, 2, kept=3) == {"steps": 5, "kept": 5, "rejected_messages": 0}
    assert life(path, clock, 0, kept=5)["steps"] == 5


def test_services_that_share_a_folder_have_files_of_their_own(tmp_path):
    clock = ManualClock(0)
    for name, count in (("a", 3), ("b", 5)):
        make_sums(str(tmp_path), name, clock).write({"steps": count})
    for name, count in (("a", 3), ("b", 5), ("c", 0)):
        again = make_sums(str(tmp_path), name, clock)
        assert again.total({"steps": 1}, ()) == {"steps": count + 1}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "b.json"]


def test_one_that_is_killed_loses_no_more_than_a_second_of_counts(tmp_path):
    clock, path = ManualClock(0), tmp_path / "a.sums.json"
    transport = MemoryTransport(MemoryHub(), name="a", clock=clock)
    running = RunningService(Counting(), transport, Sums(path, clock))
    for _ in range(25):
        clock.advance_s(0.1)
        running.step()
    assert 15 <= json.loads(path.read_text())["steps"] <= 25
    running.write_sums()
    assert json.loads(path.read_text())["steps"] == 25


@pytest.mark.parametrize("text", ["", "[1]", '{"steps": "many"}', "{"])
def test_a_damaged_file_is_said_and_counts_begin_anew(tmp_path, text, caplog):
    path = tmp_path / "sums"
    path.write_text(text)
    assert Sums(path, ManualClock(0)).total({"steps": 1}, ()) == {"steps": 1}
    assert "sums begin anew" in caplog.text


def test_a_full_disk_is_said_once_and_the_service_goes_on(tmp_path, full_disk, caplog):
    sums = Sums(tmp_path / "sums", ManualClock(0))
    sums.write({"steps": 1})
    with full_disk(1):
        sums.write({"steps": 2})
        sums.write({"steps": 3})
    assert caplog.text.count("sums are not kept") == 1
    assert json.loads((tmp_path / "sums").read_text()) == {"steps": 1}


def test_no_file_is_no_sums_and_one_in_no_folder_is_bad_input(tmp_path):
    assert make_sums("", "a", ManualClock(0)) is None
    with pytest.raises(BadInputError, match=r"sums .*/none/sums: expected a file in a folder"):
        make_sums(str(tmp_path / "none" / "sums"), "a", ManualClock(0))


WHO = {"run": "default", "role": "replay", "service": "replay"}


@pytest.fixture
def lines() -> list[str]:
    """What is logged, a line for programs each."""
    found: list[str] = []
    formatter = JsonFormatter(WHO)

    class Kept(logging.Handler):
        def emit(self, record):
            found.append(formatter.format(record))

    handler = Kept()
    logging.getLogger("gfm").addHandler(handler)
    yield found
    logging.getLogger("gfm").removeHandler(handler)


def test_a_line_for_programs_says_who_logs_it_and_whose_message_it_is_about(lines):
    Refusals().add("range", 'actor "1"\n', "reward is 1e30")
    line = json.loads(lines[0])
    assert line["time"].endswith("Z")
    del line["time"]
    assert line == {
        "level": "warning",
        "logger": "gfm.service.refusals",
        "message": "refused a message of actor__1__: reward is 1e30 (range, 1 so far)",
        **WHO,
        "sender": "actor__1__",
        "reason": "range",
    }
    assert "\n" not in lines[0]


def test_a_traceback_is_in_its_line():
    try:
        raise ValueError("no\nmore")
    except ValueError:
        record = logging.LogRecord("gfm", logging.ERROR, "f", 1, "it failed", (), sys.exc_info())
    text = JsonFormatter(WHO).format(record)
    assert "ValueError: no\nmore" in json.loads(text)["error"]
    assert "\n" not in text
