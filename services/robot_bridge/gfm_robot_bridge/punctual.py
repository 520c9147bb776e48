"""What keeps the bridge's process on time: its collector, its threads, its priority."""

from __future__ import annotations

import gc
import os
import sys
import threading
from pathlib import Path

from gfm.core import ConfigError

#: A thread that computes hands over to one that waits after so long, s; Python's own is 5 ms, by
#: which a period would begin late whenever the recorder is at work.
_SWITCH_S = 5e-4
#: Above all that is not real-time; interrupts' threads have 50.
_PRIORITY = 10
_TASKS = Path("/proc/self/task")


def settle() -> None:
    """Takes what exists by now from the collector's view, for good; threads switch sooner.

    A full collection of modules and models takes 26 ms, of which a period of 20 Hz has 50.
    """
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(_SWITCH_S)


def go_before_others(but: frozenset[str]) -> None:
    """Lets all threads of this process run before whatever is not real-time (SCHED_FIFO).

    Threads that they start later do, too. No process starves: the system leaves 5 % to the others.

    Args:
        but: Names of threads that stay as they are: what they do may wait.

    Raises:
        ConfigError: this process has no right to that, or the system knows no such thing.
    """
    waiting = {thread.native_id for thread in threading.enumerate() if thread.name in but}
    if not hasattr(os, "sched_setscheduler"):
        raise ConfigError("realtime is true, expected Linux: this system has no SCHED_FIFO")
    try:
        for task in _TASKS.iterdir():
            if int(task.name) not in waiting:
                os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except PermissionError as exc:
        raise ConfigError(
            f"realtime is true and this process may not ask for SCHED_FIFO; expected the right to "
            f"priority {_PRIORITY} (`ulimit -r`, rtprio in limits.conf, or CAP_SYS_NICE)"
        ) from exc
