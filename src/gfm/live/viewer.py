"""The port of viewers: they take what recordings have, while it happens."""

from __future__ import annotations

from abc import abstractmethod
from types import TracebackType
from typing import Self

from gfm.recording.topics import TopicWriter


class Viewer(TopicWriter):
    """Shows what is written to it. One that is slow, or gone, loses the oldest of it."""

    @abstractmethod
    def welcome(self) -> None:
        """Tells those who came lately what was said once before."""

    @abstractmethod
    def close(self) -> None:
        """Ends it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
