"""Small parts of the bridge: histograms, and joints that fall behind."""

from __future__ import annotations

import numpy as np
import pytest

from gfm_robot_bridge.following import Told, behind
from gfm_robot_bridge.timing import Histogram

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
