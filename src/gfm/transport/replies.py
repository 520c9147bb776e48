"""What replies of every adapter do alike: decode once, remember, let a next one count."""

from __future__ import annotations

from abc import abstractmethod

from typing_extensions import override

from gfm.core import GfmError
from gfm.transport.bodies import Bodies
from gfm.transport.port import PendingReply
from gfm_wire import Message


class BodyReply(PendingReply):
    """A reply whose bodies an adapter receives."""

    def __init__(self, key: str, bodies: Bodies) -> None:
        self._key = key
        self._bodies = bodies
        self._answer: Message | None = None
        self._failure: GfmError | None = None

    @abstractmethod
    def _next(self) -> bytes | None:
        """Returns a body that has arrived, or None while one is under way.

        Raises:
            UnreachableError: there will be none.
        """

    @override
    def poll(self) -> Message | None:
        if self._failure is not None:
            raise _without_traceback(self._failure)
        if self._answer is None:
            try:
                body = self._next()
                if body is not None:
                    self._answer, self.stamp = self._bodies.answer(self._key, body)
            except GfmError as failure:
                self._failure = _without_traceback(failure)
                raise
        return self._answer

    @override
    def reject(self) -> None:
        self._answer = self._failure = None


def _without_traceback(failure: GfmError) -> GfmError:
    """Returns a failure to be kept, or to be raised once more.

    One that was raised holds every frame that it went through, and so the reply that keeps it: the
    two would stay until Python looks for cycles, which it does the more rarely the longer a process
    lives.
    """
    again = type(failure).__new__(type(failure), *failure.args)
    again.__dict__.update(vars(failure))
    return again
