"""The verdict on an hour's soak: who grew is told from who only breathes."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
import soak

from gfm.service import exit_status


def rows(memory, files=lambda _: 20.0, missing=(), minutes=60, held=None):
    held = held or (lambda t: 0.5 * memory(t))
    return [
        {
            "at_s": 10.0 * i,
            "missing": list(missing) if i == 7 else [],
            "memory_mib": {"replay": memory(i / (6 * minutes))},
            "heap_mib": {"replay": held(i / (6 * minutes))},
            "open_files": {"replay": files(i / (6 * minutes))},
            "cpu_s": 15.0 * i,
            "env_steps": 8000 * i,
            "replay_sequences": 800 * i,
            "learner_steps": 300 * i,
        }
        for i in range(6 * minutes + 1)
    ]


def verdict(found):
    (course,) = soak.courses(found)
    return course


def test_what_fills_at_first_and_breathes_after_that_is_flat():
    course = verdict(rows(lambda t: min(50.0 + 300.0 * t, 90.0) + (t * 1e4) % 1.0))
    assert course.is_flat
    assert max(abs(course.held_mib_h), abs(course.resident_mib_h)) < 0.1


@pytest.mark.parametrize("growth_mib_h", [2.5, 20.0])
def test_what_goes_on_growing_is_not(growth_mib_h):
    course = verdict(rows(lambda t: 60.0 + growth_mib_h * t))
    assert not course.is_flat
    assert course.resident_mib_h == pytest.approx(growth_mib_h, rel=0.02)
    assert course.held_mib_h == pytest.approx(0.5 * growth_mib_h, rel=0.02)
    # The beginnings of the first and the last eighth are seven twelfths of the time apart.
    first, last = course.memory_mib
    assert last - first == pytest.approx(7 / 12 * growth_mib_h, rel=0.03)


def test_what_fills_and_empties_again_is_no_growth():
    course = verdict(rows(lambda t: 60.0 + 30.0 * (t * 361 % 7 > 3)))
    assert course.memory_mib == (60.0, 60.0)
    assert course.is_flat


def test_what_cannot_be_told_from_growth_is_not_flat():
    steps = [0.0, 0.0, 3.0, 3.0, 0.0, 0.0, 3.0, 3.0, 3.0, 0.0, 3.0, 3.0, 0.0]
    course = verdict(rows(lambda _: 60.0, held=lambda t: 40.0 + steps[int(12 * t)]))
    assert not course.is_flat
    assert course.held_mib_h < 2.0 < course.held_mib_h + 2.0 * course.error_mib_h


def test_a_step_of_what_malloc_keeps_is_no_growth_unless_it_is_large():
    assert verdict(rows(lambda t: 60.0 + 1.0 * (t > 0.8), held=lambda _: 40.0)).is_flat
    assert not verdict(rows(lambda t: 60.0 + 1.5 * (t > 0.8), held=lambda _: 40.0)).is_flat


def test_what_a_process_holds_grows_also_where_it_was_larger_before():
    assert not verdict(rows(lambda _: 60.0, held=lambda t: 40.0 + 3.0 * t)).is_flat


def test_of_a_large_process_a_fiftieth_an_hour_is_no_growth():
    assert verdict(rows(lambda t: 400.0 + 7.0 * t)).is_flat
    assert not verdict(rows(lambda t: 400.0 + 9.0 * t)).is_flat


def test_a_line_has_the_textbook_s_slope_and_error():
    x, y = [0.0, 1.0, 2.0, 3.0], [1.0, 3.0, 2.0, 4.0]
    slope, error = soak.line(x, y)
    assert slope == pytest.approx(0.8)
    assert error == pytest.approx(np.sqrt(1.8 / 2 / 5))
    assert soak.line([0.0, 1.0], [0.0, 5.0]) == (0.0, np.inf)


def test_handles_that_leak_are_found():
    assert verdict(rows(lambda _: 50.0, lambda t: 20.0 + 2.0 * t)).is_flat
    assert not verdict(rows(lambda _: 50.0, lambda t: 20.0 + 10.0 * t)).is_flat


def test_the_table_tells_how_much_was_done_and_used():
    said = "\n".join(soak.table(rows(lambda _: 50.0, missing=["replay: down"])))
    assert "| replay | 50.0 | 50.0 | +0.00 | +0.00 ± 0.00 | 20 and 20 |" in said
    assert "60 minutes, looked at after 20; 800 env_steps/s, 80 replay_sequences/s" in said
    assert "1.50 of " in said
    assert said.endswith(
        "looks: 361, at which somebody did not answer in time: 0, at which somebody was missing: 1"
    )


def test_looks_at_which_nobody_answered_are_told_and_count_for_nothing():
    found = rows(lambda _: 50.0)
    gauges = {gauge: {} for gauge in ("memory_mib", "heap_mib", "open_files")}
    silent = {**found[200], **gauges, "env_steps": 0}
    found[200] = silent
    found[-1] = {**silent, "at_s": found[-1]["at_s"]}
    assert verdict(found).memory_mib == (50.0, 50.0)
    said = "\n".join(soak.table(found))
    assert "800 env_steps/s" in said
    assert "did not answer in time: 2" in said


@pytest.mark.parametrize(
    ("memory", "missing", "status"),
    [
        (lambda _: 50.0, [], 0),
        (lambda t: 50.0 + 20.0 * t, [], 1),
        (lambda _: 50.0, ["replay: down for 0 s"], 1),
    ],
    ids=["flat", "grew", "died"],
)
def test_the_status_says_whether_all_is_well(
    tmp_path, monkeypatch, capsys, memory, missing, status
):
    monkeypatch.setattr(soak, "soak", lambda *_: rows(memory, missing=missing))
    monkeypatch.setattr(sys, "argv", ["soak", "--folder", str(tmp_path / "new")])
    assert soak.main() == status
    assert "| replay |" in capsys.readouterr().out


def test_a_folder_that_is_there_is_left_alone(tmp_path, monkeypatch, capsys):
    (tmp_path / soak.LOG).write_text(json.dumps({}))
    monkeypatch.setattr(sys, "argv", ["soak", "--folder", str(tmp_path)])
    assert exit_status(soak.main) == 2
    assert "exists, expected a new one" in capsys.readouterr().err


@pytest.mark.slow
def test_a_system_at_full_load_is_looked_at(tmp_path):
    found = soak.soak(tmp_path, 0.5)
    assert len(found) >= 2
    assert set(found[-1]["memory_mib"]) == {
        "router",
        "replay",
        "learner",
        *(f"actor-{i}" for i in range(soak.ACTORS)),
    }
    assert found[-1]["env_steps"] > found[0]["env_steps"]
