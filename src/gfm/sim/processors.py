"""How many processors there are to simulate on."""

from __future__ import annotations

import os


def processors() -> int:
    """Returns on how many processors this process may run: what taskset and batch queues set."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
