"""Log lines on stderr: for people, or one JSON object per line for whoever collects them."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Literal, final

from typing_extensions import override

LogLevel = Literal["debug", "info", "warning", "error"]
LogFormat = Literal["text", "json"]

ABOUT = ("sender", "sequence", "reason")
"""What a line may say beside its text, by `extra`: whose message it is about, which of it, and the
word under which a refusal is counted."""

_TEXT = "%(asctime)s %(levelname)s %(name)s: %(message)s"


@final
class JsonFormatter(logging.Formatter):
    """One line per event: when, how severe, where in the code, what, and who says it."""

    def __init__(self, who: Mapping[str, str]) -> None:
        """Keeps what every line says.

        Args:
            who: Run, role and service, by name.
        """
        super().__init__()
        self._who = dict(who)

    @override
    def format(self, record: logging.LogRecord) -> str:
        at = datetime.fromtimestamp(record.created, UTC)
        line: dict[str, object] = {
            "time": at.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **self._who,
        }
        line |= {name: vars(record)[name] for name in ABOUT if name in vars(record)}
        if record.exc_info:
            line["error"] = self.formatException(record.exc_info)
        return json.dumps(line)


def start_logging(
    level: LogLevel, form: LogFormat = "text", who: Mapping[str, str] | None = None
) -> None:
    """Sends log lines to stderr.

    Args:
        level: Least severe event that is logged.
        form: For people, or for programs.
        who: What every line for programs says of its process.
    """
    handler = logging.StreamHandler()
    text = logging.Formatter(_TEXT)
    handler.setFormatter(text if form == "text" else JsonFormatter(who or {}))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)
