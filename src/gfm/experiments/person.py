"""Whoever watches a robot: single keys from a terminal, and what they mean."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from types import TracebackType
from typing import Self, TextIO, final

from gfm.core import BadInputError

PAUSE, END, CONFIRM = " ", "q", ("\n", "\r")


@final
class Keyboard:
    """Keys as they are typed, without waiting for Enter, while the context is open.

    Args:
        stream: Standard input; where it is no terminal, no key is ever typed.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        stream = stream or sys.stdin
        self._descriptor = stream.fileno() if stream.isatty() else None
        self._restore: Callable[[], None] | None = None

    @property
    def is_there(self) -> bool:
        """Whether there is a terminal."""
        return self._descriptor is not None

    def key(self) -> str:
        """Returns the oldest key that was not asked for yet; nothing where there is none."""
        if self._descriptor is None or not select.select([self._descriptor], [], [], 0.0)[0]:
            return ""
        return os.read(self._descriptor, 1).decode(errors="replace")

    def __enter__(self) -> Self:
        if self._descriptor is not None:
            before = termios.tcgetattr(self._descriptor)
            self._restore = partial(termios.tcsetattr, self._descriptor, termios.TCSADRAIN, before)
            tty.setcbreak(self._descriptor)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._restore is not None:
            self._restore()


@final
@dataclass(kw_only=True)
class Person:
    """What somebody wants of a robot that is driven: space pauses, q ends, Enter confirms.

    Attributes:
        key: Returns the next key, or nothing; as `Keyboard.key`.
        stopped: Whether a signal asks to end.
        say: Tells the person something.
        is_there: Whether anybody can be asked.
        ended: Whether the person, or a signal, ended it.
    """

    key: Callable[[], str] = lambda: ""
    stopped: Callable[[], bool] = lambda: False
    say: Callable[[str], None] = lambda _words: None
    is_there: bool = False
    ended: bool = False
    _paused: bool = field(default=False, init=False)

    def interrupts(self) -> bool:
        """Returns whether what is under way shall be broken off; asked before every command."""
        key = self.key()
        self._paused |= key == PAUSE
        self.ended |= key == END or self.stopped()
        return self._paused or self.ended

    def resumes(self, rest: Callable[[], None]) -> bool:
        """Returns whether to go on after an interruption, when that is known.

        Args:
            rest: Lets the robot stand for a moment; called until then.
        """
        if self._paused and not self.ended:
            self.say("paused: space goes on, q ends")
        while self._paused and not self.ended:
            rest()
            key = self.key()
            self._paused ^= key == PAUSE
            self.ended |= key == END or self.stopped()
        return not self.ended

    def confirms(self, request: str, rest: Callable[[], None]) -> bool:
        """Asks for something and returns whether Enter says that it was done; False: to end.

        Args:
            request: What to do.
            rest: As of `resumes`.

        Raises:
            BadInputError: nobody is there to do it.
        """
        if not self.is_there:
            raise BadInputError(
                f"{request}: a person has to do that, expected a terminal as standard input"
            )
        self.say(f"{request}, then press Enter (q ends)")
        while not self.ended:
            rest()
            key = self.key()
            if key in CONFIRM:
                return True
            self.ended |= key == END or self.stopped()
        return False
