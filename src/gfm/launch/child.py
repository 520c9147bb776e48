"""Runs a module as a child that does not outlive its parent: `python -m gfm.launch.child MODULE`.

The parent holds the other end of standard input. When the parent ends, however it ends, the pipe
closes: the child is asked to stop as by SIGTERM, and killed where it does not.
"""

from __future__ import annotations

import os
import runpy
import signal
import sys
import time
from threading import Thread

GRACE_S = 10.0
"""How long an orphan may take to stop by itself."""


def _end_with_parent() -> None:
    while os.read(0, 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_S)
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    """Watches the parent and becomes the module that the command line names."""
    Thread(target=_end_with_parent, name="end-with-parent", daemon=True).start()
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
