"""Whoever watches a robot: keys from a terminal, and what they mean."""

from __future__ import annotations

import os
import termios

import pytest

from gfm.core import BadInputError
from gfm.experiments.person import Keyboard, Person


class Typing:
    """Somebody who types one key at a time, and hears what is said."""

    def __init__(self, keys: str, stopped_after: int = 10**9) -> None:
        self.heard: list[str] = []
        self.rests = 0
        self._keys = list(keys)
        self._stopped_after = stopped_after
        self.person = Person(key=self.key, stopped=self.stopped, say=self.heard.append)
        self.person.is_there = True

    def key(self) -> str:
        typed = self._keys.pop(0) if self._keys else ""
        return "" if typed == "." else typed  # a dot: nothing is typed for once

    def stopped(self) -> bool:
        return self.rests >= self._stopped_after

    def rest(self) -> None:
        self.rests += 1


def test_keys_come_from_a_terminal_without_enter_and_it_is_left_as_it_was():
    outer, inner = os.openpty()
    try:
        before = termios.tcgetattr(inner)
        with os.fdopen(inner, closefd=False) as stream, Keyboard(stream) as keyboard:
            assert keyboard.is_there
            assert not termios.tcgetattr(inner)[3] & termios.ICANON
            assert keyboard.key() == ""
            os.write(outer, b" q")
            assert [keyboard.key() for _ in range(3)] == [" ", "q", ""]
        assert termios.tcgetattr(inner) == before
    finally:
        os.close(outer)
        os.close(inner)


def test_without_a_terminal_nothing_is_typed():
    reading, writing = os.pipe()
    os.write(writing, b"q")
    os.close(writing)
    with os.fdopen(reading) as stream, Keyboard(stream) as keyboard:
        assert not keyboard.is_there
        assert keyboard.key() == ""


def test_nobody_interrupts():
    person = Person()
    assert not person.interrupts()
    assert person.resumes(lambda: None)
    with pytest.raises(
        BadInputError, match="put it back: a person has to do that, expected a term"
    ):
        person.confirms("put it back", lambda: None)


def test_space_pauses_until_space():
    typing = Typing("x ..x ")
    assert not typing.person.interrupts()
    assert typing.person.interrupts()
    assert typing.person.resumes(typing.rest)
    assert typing.rests == 4
    assert typing.heard == ["paused: space goes on, q ends"]
    assert not typing.person.interrupts()


@pytest.mark.parametrize("typing", [Typing(" .q"), Typing(" ...", stopped_after=2)])
def test_q_or_a_signal_ends_a_pause(typing):
    assert typing.person.interrupts()
    assert not typing.person.resumes(typing.rest)
    assert typing.rests == 2
    assert typing.person.ended


def test_q_or_a_signal_ends_at_once():
    for typing in (Typing("q"), Typing("", stopped_after=0)):
        assert typing.person.interrupts()
        assert not typing.person.resumes(typing.rest)
        assert typing.rests == 0


def test_enter_confirms_and_q_does_not():
    for keys, confirmed in ((".x\n", True), ("..\r", True), ("..q", False)):
        typing = Typing(keys)
        assert typing.person.confirms("put it back", typing.rest) is confirmed
        assert typing.rests == 3
        assert typing.heard == ["put it back, then press Enter (q ends)"]
