"""The one way in which processes talk: broadcast the newest, ask and be answered.

Nothing here blocks unless it says so, so that a service can be one class with a `step` method and
a whole system can be stepped in one thread. Messages are values of `gfm.core`; an adapter encodes
them with `gfm_wire`, the in-memory one included, so that both refuse the same bodies.

Keys are relative to a run: the adapter prefixes `gfm/<run>/`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from gfm_wire import Message, Stamp


class Subscription(ABC):
    """Messages published under one key; keeps a bounded number of the newest.

    Attributes:
        stamp: Of the connection that sent the message taken last.
    """

    stamp: Stamp

    @abstractmethod
    def take(self) -> Message | None:
        """Returns the oldest message that is kept, or None. Bodies that are refused are counted."""

    def latest(self) -> Message | None:
        """Returns the newest message and forgets the older ones, or None."""
        newest = None
        while (message := self.take()) is not None:
            newest = message
        return newest


class PendingReply(ABC):
    """An answer that has been asked for.

    Attributes:
        stamp: Of the connection that answered; once there is an answer.
    """

    stamp: Stamp

    @abstractmethod
    def poll(self) -> Message | None:
        """Returns the answer, or None while it is under way; once answered, the same again.

        Raises:
            UnreachableError: the deadline passed, or the other side went away.
            RefusedError: the other side said no, or its answer cannot be understood.
        """

    @abstractmethod
    def reject(self) -> None:
        """Forgets the answer: where several were asked, `poll` waits for that of another."""


class Request(ABC):
    """A question that has arrived. Exactly one of `reply` and `refuse` is called.

    Attributes:
        message: What is asked.
        stamp: Of the connection that asks.
    """

    message: Message
    stamp: Stamp

    @abstractmethod
    def reply(self, message: Message) -> None:
        """Answers."""

    @abstractmethod
    def refuse(self, reason: str) -> None:
        """Says no: the asker gets a RefusedError with this text."""


class Server(ABC):
    """Questions asked under one key. Bodies that are refused are answered so, and counted."""

    @abstractmethod
    def receive(self) -> Request | None:
        """Returns the oldest question, or None."""


class Transport(ABC):
    """One process's connection to a run."""

    #: Messages that were refused so far, by reason.
    rejected: dict[str, int]

    @abstractmethod
    def publish(self, key: str, message: Message) -> None:
        """Broadcasts; a receiver that does not keep up loses old messages, the sender no time.

        Raises:
            WireError: the message is too large to be sent; so does `request`.
        """

    @abstractmethod
    def subscribe(self, key: str, *, keep: int = 1) -> Subscription:
        """Returns a subscription that keeps the newest `keep` messages."""

    @abstractmethod
    def request(
        self, key: str, message: Message, *, timeout_s: float, everybody: bool = False
    ) -> PendingReply:
        """Asks whoever serves `key`; returns at once.

        Args:
            key: What is asked about.
            message: The question.
            timeout_s: How long to wait for an answer.
            everybody: Whether all who serve the key are asked, should there be several; the first
                answer counts unless it is rejected.
        """

    @abstractmethod
    def survey(self, key: str, message: Message, *, timeout_s: float) -> list[Message]:
        """Asks everybody who serves a key matching `key` (`*` stands for one part). Blocks."""

    @abstractmethod
    def serve(self, key: str) -> Server:
        """Starts to answer questions under `key`."""

    @abstractmethod
    def close(self) -> None:
        """Ends the connection; what was acknowledged before has arrived."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
