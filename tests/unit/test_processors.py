"""Threads are as many as the processors that a process may run on."""

from __future__ import annotations

import os

import pytest

from gfm.sim.processors import processors


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system binds no process")
def test_a_bound_process_counts_its_own_processors() -> None:
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        assert processors() == 1
    finally:
        os.sched_setaffinity(0, allowed)
    assert processors() == len(allowed)


@pytest.mark.parametrize(("counted", "there"), [(6, 6), (None, 1)])
def test_where_no_process_is_bound_all_count(
    monkeypatch: pytest.MonkeyPatch, counted: int | None, there: int
) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: counted)
    assert processors() == there
