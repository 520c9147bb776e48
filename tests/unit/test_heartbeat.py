"""Signs of life: the file that a loop touches, and who answers while a step lasts."""

from __future__ import annotations

import ctypes
import os
import threading
from typing import final

import pytest
from typing_extensions import override

from gfm.core import BadInputError, ManualClock, MonotonicClock, Status
from gfm.service import RunningService, Service, make_status, run_service
from gfm.service.heartbeat import FileHeartbeat, NoHeartbeat, make_heartbeat
from gfm.service.stand_in import StandIn
from gfm.service.usage import process_usage
from gfm.transport import MemoryHub, MemoryTransport
from gfm_wire import StatusRequest


@final
class Counting(Service):
    """Counts its steps; one of them waits for whatever it is given."""

    def __init__(self, slow: threading.Event | None = None) -> None:
        self.steps = 0
        self.began = threading.Event()
        self._slow = slow

    @override
    def step(self) -> bool:
        self.steps += 1
        self.began.set()
        if self._slow is not None:
            assert self._slow.wait(30.0)
        return True

    @override
    def status(self) -> Status:
        return make_status("learner", "l", counters={"steps": self.steps}, note="learning")

    @override
    def close(self) -> None:
        pass


def test_there_is_no_heartbeat_before_the_first_beat_and_none_after_the_end(tmp_path):
    path = tmp_path / "beat"
    path.write_text("of an earlier process")
    heartbeat = make_heartbeat(str(path), ManualClock())
    assert not path.exists()
    heartbeat.beat()
    assert path.read_text() == f"{os.getpid()}\n"
    heartbeat.end()
    assert not path.exists()


def test_a_beat_touches_the_file_twice_a_second_at_most(tmp_path):
    path, clock = tmp_path / "beat", ManualClock()
    heartbeat = FileHeartbeat(path, clock)
    heartbeat.beat()
    os.utime(path, (0, 0))
    clock.advance_s(0.4)
    heartbeat.beat()
    assert path.stat().st_mtime == 0.0
    clock.advance_s(0.1)
    heartbeat.beat()
    assert path.stat().st_mtime > 0.0
    path.unlink()
    clock.advance_s(0.5)
    heartbeat.beat()
    assert path.read_text() == f"{os.getpid()}\n"


def test_a_heartbeat_needs_a_folder(tmp_path):
    with pytest.raises(BadInputError, match=r"none/beat: expected a file in a folder that exists"):
        make_heartbeat(str(tmp_path / "none" / "beat"), ManualClock())
    assert isinstance(make_heartbeat("", ManualClock()), NoHeartbeat)


def test_a_loop_beats_with_its_own_steps_and_ends_its_heartbeat(tmp_path):
    path, service = tmp_path / "beat", Counting()

    def stopped() -> bool:
        assert path.exists() is (service.steps > 0)
        return service.steps == 3

    clock = ManualClock()
    transport = MemoryTransport(MemoryHub())
    run_service(service, transport, clock, stopped, FileHeartbeat(path, clock))
    assert not path.exists()


def test_the_stand_in_is_silent_in_short_steps_and_tells_the_last_words_in_long_ones():
    hub, clock, told = MemoryHub(), ManualClock(), False
    running = RunningService(Counting(), MemoryTransport(hub))
    stand_in = StandIn(running, clock, lambda: told)
    pending = MemoryTransport(hub).request("status/learner/l", StatusRequest(), timeout_s=60.0)
    clock.advance_s(1.0)
    stand_in.turn()
    clock.advance_s(0.2)
    stand_in.answer()
    assert pending.poll() is None
    clock.advance_s(6.8)
    told = True
    stand_in.answer()
    status = pending.poll()
    assert isinstance(status, Status)
    assert status.note == "learning; in one step for 7.0 s; told to stop, after this step"
    assert status.gauges["step_s"] == pytest.approx(7.0)


def test_a_service_is_answered_for_while_it_is_in_a_step():
    hub, over = MemoryHub(), threading.Event()
    service = Counting(slow=over)
    loop = threading.Thread(
        target=run_service,
        args=(service, MemoryTransport(hub), MonotonicClock(), over.is_set),
    )
    loop.start()
    try:
        assert service.began.wait(30.0)
        asking = MemoryTransport(hub)
        pending = asking.request("status/learner/l", StatusRequest(), timeout_s=60.0)
        while (status := pending.poll()) is None:
            over.wait(0.01)
    finally:
        over.set()
        loop.join()
    assert isinstance(status, Status)
    assert "in one step for" in status.note
    assert status.gauges["step_s"] >= 0.3


def test_a_process_says_what_it_uses():
    usage = process_usage()
    if usage:  # only Linux tells
        assert usage["memory_mib"] > 1.0
        assert usage["open_files"] >= 3.0


def test_what_malloc_hands_out_is_told_from_what_it_keeps():
    if "heap_mib" not in process_usage():
        pytest.skip("no glibc of 2.33 or newer")
    before = process_usage()["heap_mib"]
    held = ctypes.create_string_buffer(32 * 2**20)
    assert process_usage()["heap_mib"] - before == pytest.approx(32.0, abs=1.0)
    del held
    assert process_usage()["heap_mib"] - before == pytest.approx(0.0, abs=1.0)
