"""One child process: started, watched, read and stopped."""

from __future__ import annotations

import logging
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import final

from gfm.core import BadInputError, ProcessDiedError
from gfm.launch.spec import ProcessSpec

_log = logging.getLogger(__name__)

_LAST_LINES = 12


@final
class ChildProcess:
    """A service as a process of its own, in a session of its own.

    Ctrl-C in a terminal reaches the parent alone, which then stops its children in order.
    """

    def __init__(self, spec: ProcessSpec, arguments: Sequence[str], log_dir: Path) -> None:
        self.spec = spec
        self.log_path = log_dir / f"{spec.name}.log"
        with self.log_path.open("wb") as log:
            self._popen = subprocess.Popen(
                [sys.executable, "-m", "gfm.launch.child", spec.module, *arguments],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        _log.info("%s: started, pid %d", spec.name, self.pid)

    @property
    def pid(self) -> int:
        """The process id."""
        return self._popen.pid

    def check(self) -> None:
        """Returns while the process runs.

        Raises:
            BadInputError: it ended because it was told something that it cannot do.
            ProcessDiedError: it ended for another reason.
        """
        status = self._popen.poll()
        if status is None:
            return
        lines = self.last_lines()
        if status == 2 and lines:
            raise BadInputError(f"{self.spec.name}: {lines[-1].removeprefix('error: ')}")
        raise ProcessDiedError(self.spec.name, status, self.log_path, lines)

    def last_lines(self) -> list[str]:
        """Returns the end of the process's log."""
        text = self.log_path.read_text(encoding="utf-8", errors="replace")
        return text.splitlines()[-_LAST_LINES:]

    def terminate(self) -> None:
        """Asks the process to stop."""
        if self._popen.poll() is None:
            self._popen.terminate()

    def finish(self, timeout_s: float) -> None:
        """Waits for the process to end, and kills it where it does not."""
        try:
            self._popen.wait(timeout_s)
        except subprocess.TimeoutExpired:
            _log.warning("%s: still running after %.0f s, killed", self.spec.name, timeout_s)
            self._popen.kill()
            self._popen.wait()
        if self._popen.stdin is not None:
            self._popen.stdin.close()
        _log.info("%s: ended with status %d", self.spec.name, self._popen.returncode)
