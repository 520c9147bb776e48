"""How many messages this process's router dropped, because a role may not, or for their size.

zenoh counts them nowhere. Its trace log has one line for each, on standard output; who sent it, and
under which key, stands in lines that there are for every message that is let through, too, which
would cost more than it tells.
"""

from __future__ import annotations

import os
import sys
import threading
from typing import final

import zenoh

_INTERCEPTORS = "zenoh::net::routing::interceptor"
_QUIET = ("access_control", "low_pass", "downsampling")
_FILTER = ",".join(
    ("off", f"{_INTERCEPTORS}=trace", *(f"{_INTERCEPTORS}::{name}=off" for name in _QUIET))
)
_DROPPED = b"Msg intercepted"
_STANDARD_OUTPUT = 1


@final
class Drops:
    """Reads that log from now on, for as long as the process lives: there is one per process.

    Standard output is zenoh's from then on. Other lines of its log, which RUST_LOG may ask for, go
    to standard error. Who is not allowed to hear a declaration counts, too, once for each: some are
    dropped whenever a process joins.
    """

    def __init__(self) -> None:
        self._count = 0
        reading, writing = os.pipe()
        os.dup2(writing, _STANDARD_OUTPUT)
        os.close(writing)
        zenoh.init_log_from_env_or(_FILTER)
        threading.Thread(target=self._read, args=(reading,), name="drops", daemon=True).start()

    @property
    def count(self) -> int:
        """Messages that were dropped so far."""
        return self._count

    def _read(self, reading: int) -> None:
        with os.fdopen(reading, "rb") as log:
            for line in log:
                if _DROPPED in line:
                    self._count += 1
                else:
                    sys.stderr.buffer.write(line)
                    sys.stderr.buffer.flush()
