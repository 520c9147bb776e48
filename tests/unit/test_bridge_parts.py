"""Small parts of the bridge: histograms, and joints that fall behind."""

from __future__ import annotations

import gc
import os
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from gfm.core import ConfigError
from gfm_robot_bridge import punctual
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.following import Told, behind
from gfm_robot_bridge.timing import Histogram
from gfm_wire import RobotClock

MS = 1_000_000
STILL = np.full(2, 0.01)


def test_a_histogram_counts_up_to_the_end_of_each_bin() -> None:
    histogram = Histogram("jitter")
    for duration_ns in (-5, 0, MS // 10, MS // 10 + 1, 5 * MS, 5 * MS + 1, 80 * MS):
        histogram.add(duration_ns)
    counted = {name: count for name, count in histogram.counters().items() if count}
    assert counted == {
        "jitter_to_0.1_ms": 3,
        "jitter_to_0.2_ms": 1,
        "jitter_to_5_ms": 1,
        "jitter_to_10_ms": 1,
        "jitter_over_50_ms": 1,
    }
    assert histogram.gauges()["jitter_most_ms"] == 80.0


@pytest.mark.parametrize(("late", "expected"), [(1, 1.0), (2, 7.0)])
def test_99_of_100_are_at_most_as_long_as_it_says(late: int, expected: float) -> None:
    histogram = Histogram("jitter")
    for _ in range(100 - late):
        histogram.add(round(0.9 * MS))
    for _ in range(late):
        histogram.add(7 * MS)
    assert histogram.gauges()["jitter_p99_ms"] == expected


def test_an_empty_histogram_has_no_longest() -> None:
    assert Histogram("x").gauges() == {"x_p99_ms": 0.0, "x_most_ms": 0.0}


def test_a_position_is_behind_by_what_exceeds_the_servos_lag() -> None:
    told = Told(speed=np.array([1.0, 0.0]), position=np.array([0.5, 0.5]))
    late = behind(np.zeros(2), told, np.array([0.3, 0.3]), np.zeros(2), STILL, 0.02)
    np.testing.assert_allclose(late, [0.05, 0.2])


@pytest.mark.parametrize(
    ("told", "velocity", "before", "expected"),
    [
        (0.5, 0.0, 0.0, 0.0028),  # 0.02 s at 0.3 * 0.5 - 0.01
        (-0.5, 0.0, 0.0, 0.0028),
        (0.5, 0.5, 0.02, 0.0128),
        (0.5, 0.5, 0.001, 0.0),
        (0.0, 0.4, 0.0, 0.0),
    ],
)
def test_a_speed_is_behind_by_the_way_that_was_not_gone(
    told: float, velocity: float, before: float, expected: float
) -> None:
    speed = Told(speed=np.array([told, 0.0]))
    moved = np.array([velocity, 0.0])
    late = behind(np.array([before, 0.0]), speed, np.zeros(2), moved, STILL, 0.02)
    np.testing.assert_allclose(late, [expected, 0.0], atol=1e-12)


@pytest.fixture
def _as_before() -> Iterator[None]:
    """Takes back what is changed of this process."""
    before = sys.getswitchinterval()
    yield
    sys.setswitchinterval(before)
    gc.unfreeze()


@pytest.mark.usefixtures("_as_before")
def test_a_settled_process_collects_nothing_of_what_it_began_with() -> None:
    punctual.settle()
    assert gc.get_freeze_count() > 10_000
    assert sys.getswitchinterval() < 1e-3


def test_all_threads_go_before_others_and_the_one_that_asks_first(monkeypatch) -> None:
    asked: dict[int, tuple[int, int]] = {}

    def note(task: int, policy: int, param: os.sched_param) -> None:
        asked[task] = (policy, param.sched_priority)

    monkeypatch.setattr(os, "sched_setscheduler", note)
    over = threading.Event()
    thread = threading.Thread(target=over.wait)
    thread.start()
    punctual.go_before_others()
    over.set()
    thread.join()
    assert asked[thread.native_id or 0] == (os.SCHED_FIFO, 10)
    assert asked[threading.get_native_id()] == (os.SCHED_FIFO, 11)


def test_whoever_may_not_go_before_others_is_told_what_is_missing(monkeypatch) -> None:
    def denied(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", denied)
    with pytest.raises(ConfigError, match=r"may not ask for SCHED_FIFO; expected the right to"):
        punctual.go_before_others()


def test_a_robot_that_waits_for_commands_needs_no_priority() -> None:
    with pytest.raises(ConfigError, match="clock is lockstep and realtime true, expected wall"):
        BridgeConfig(clock=RobotClock.LOCKSTEP, realtime=True)
