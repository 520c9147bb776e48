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


def go_before_others() -> None:
    """Lets all threads of this process run before whatever is not real-time (SCHED_FIFO).

    Threads that they start later do, too; the one that calls goes before the others. None may be
    left out, not even the one that writes files: where it is kept waiting while it holds Python's
    lock, all are. No other process starves: the system leaves them 5 %.

    Raises:
        ConfigError: this process has no right to that, or the system knows no such thing.
    """
    if not hasattr(os, "sched_setscheduler"):
        raise ConfigError("realtime is true, expected Linux: this system has no SCHED_FIFO")
    own = threading.get_native_id()
    try:
        for task in (int(path.name) for path in _TASKS.iterdir()):
            priority = os.sched_param(_PRIORITY + (task == own))
            os.sched_setscheduler(task, os.SCHED_FIFO, priority)
    except PermissionError as exc:
        raise ConfigError(
            f"realtime is true and this process may not ask for SCHED_FIFO; expected the right to "
            f"priority {_PRIORITY + 1} (`ulimit -r`, rtprio in limits.conf, or CAP_SYS_NICE)"
        ) from exc
