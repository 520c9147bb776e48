"""Benchmarks in parts: what is done stays done, and nobody does what another one does."""

from __future__ import annotations

import fcntl
from pathlib import Path

import pytest
from parts import commits, done_parts


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    asked: list[str] = []

    def work(name: str) -> dict[str, str]:
        asked.append(name)
        if name == "b" and asked.count("b") == 1:
            raise KeyboardInterrupt
        return {"of": name}

    with pytest.raises(KeyboardInterrupt):
        done_parts(tmp_path, ["a", "b", "c"], work)
    parts = done_parts(tmp_path, ["a", "b", "c"], work)
    assert asked == ["a", "b", "b", "c"]
    assert {name: part["of"] for name, part in parts.items()} == {"a": "a", "b": "b", "c": "c"}
    assert ", " not in commits(parts)


def test_what_another_one_does_is_left_to_it(tmp_path: Path) -> None:
    with (tmp_path / "a.lock").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert list(done_parts(tmp_path, ["a", "b"], lambda _name: {})) == ["b"]
    assert list(done_parts(tmp_path, ["a", "b"], None)) == ["b"]
    assert list(done_parts(tmp_path, ["a", "b"], lambda _name: {})) == ["a", "b"]
