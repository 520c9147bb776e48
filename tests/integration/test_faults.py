"""The benchmark of faults, in small: it goes on where it was, and finds nothing lost."""

from __future__ import annotations

import json
from collections import Counter

import faults
import pytest
from faults import TARGETS, done, figures, last_of_runs, plan, resumes, table

from gfm_replay.audit import Audit


def test_a_plan_has_as_many_kills_as_asked_and_of_all_else_alike():
    planned = plan(100, 60, 0)
    assert planned == plan(100, 60, 0)
    assert planned != plan(100, 60, 1)
    kinds = Counter(kind for kind, _ in planned)
    assert kinds == {"kill": 100} | dict.fromkeys((k for k in TARGETS if k != "kill"), 12)
    assert {name for kind, name in planned if kind == "kill"} == set(TARGETS["kill"])
    assert all(name in TARGETS[kind] for kind, name in planned)


def row(kind: str, whole_s: float, versions_back: int = 0, rig: int = 1) -> dict:
    return {
        "rig": rig,
        "kind": kind,
        "name": "actor-1",
        "whole_s": whole_s,
        "samples_per_insert": 7.5,
        "memory_mib": {"a": 10.0, "b": 20.0},
        "open_files": {"a": 1.0, "b": 2.0},
        "keeper_files": 9,
        "versions_back": versions_back,
        "resumes": [versions_back, 0, 1],
    }


def test_tables_and_sums_are_of_all_rows():
    rows = [row("cut", 1.0), row("kill", 2.0), row("kill", 4.0)]
    assert table(rows)[2:] == [
        "| kill | actor | 2 | 3.0 | 4.0 |",
        "| cut | actor | 1 | 1.0 | 1.0 |",
    ]
    audit = Audit(lives=2, acknowledged=5, kept=6, evicted=0, lost=1, doubled=0, changed=0)
    said = "\n".join(figures(rows, audit))
    assert "3 faults; whole after a kill: median 3.0 s" in said
    assert "5 acknowledged in 2 lives of actors; lost 1, doubled 0" in said
    assert "30 and 30" in said
    assert "samples per insert 7.500 to 7.500, held between 4 and 8" in said
    assert "0 acted on a probe as before, 0 otherwise, 1 not known" in said


def test_what_went_back_is_counted_in_each_run_of_the_command():
    counts = ((0, 1), (2, 1), (2, 1), (2, 2), (2, 2), (3, 2))
    rows = [row("cut", 1.0, count, rig) for count, rig in counts]
    assert [one["versions_back"] for one in last_of_runs(rows)] == [2, 3]
    assert resumes(rows) == (5, 0, 2)


@pytest.mark.slow
def test_a_hurt_system_loses_nothing_and_the_command_goes_on_where_it_was(
    tmp_path, monkeypatch, capsys
):
    planned = [("kill", "actor-1"), ("cut", "replay"), ("fill_disk", "replay"), ("kill", "replay")]
    monkeypatch.setattr(faults, "plan", lambda *_: planned)
    argv = ["faults", "--folder", str(tmp_path), "--kills", "2", "--others", "2"]
    (tmp_path / faults.LOG).write_text(json.dumps(row("kill", 1.0)) + "\n")
    monkeypatch.setattr("sys.argv", argv)
    assert faults.main() == 0
    assert [one["kind"] for one in done(tmp_path)] == [kind for kind, _ in planned]
    assert "lost 0, doubled 0, changed 0" in capsys.readouterr().out
