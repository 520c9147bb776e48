"""One child process: started, watched, read and stopped."""

from __future__ import annotations

import logging
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import final

from gfm.core import BadInputError, GfmError, ProcessDiedError
from gfm.launch.spec import ProcessSpec

_log = logging.getLogger(__name__)

BAD_INPUT = 2
"""Exit status of a process that was told what it cannot do: it would end so again."""

LOGS_KEPT = 20
"""Logs of earlier processes of one name: the first deaths say why, and a disk is not filled."""

_LAST_LINES = 12


@final
class ChildProcess:
    """A service as a process of its own, in a session of its own.

    Ctrl-C in a terminal reaches the parent alone, which then stops its children in order.
    The log of an earlier process of that name is kept beside it, with a number.
    """

    def __init__(self, spec: ProcessSpec, arguments: Sequence[str], log_dir: Path) -> None:
        self.spec = spec
        self.log_path = log_dir / f"{spec.name}.log"
        self._beat_path = log_dir / f"{spec.name}.beat"
        self._beaten_ns = 0
        set_aside(self.log_path)
        kept = ("--sums-file", str(log_dir / f"{spec.name}.sums.json"))
        told = (*arguments, "--heartbeat-file", str(self._beat_path), *kept)
        with self.log_path.open("wb") as log:
            self._popen = subprocess.Popen(
                [sys.executable, "-m", "gfm.launch.child", spec.module, *told],
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

    @property
    def status(self) -> int | None:
        """The exit status, negative where a signal ended it; None while the process runs."""
        return self._popen.poll()

    def check(self) -> None:
        """Returns while the process runs; raises what `death` returns where it has ended."""
        if self.status is not None:
            raise self.death()

    def death(self) -> GfmError:
        """Returns why the process ended: BadInputError where it was told what it cannot do."""
        status = self._popen.wait()
        lines = self.last_lines()
        if status == BAD_INPUT and lines:
            return BadInputError(f"{self.spec.name}: {lines[-1].removeprefix('error: ')}")
        return ProcessDiedError(self.spec.name, status, self.log_path, lines)

    def has_beaten(self) -> bool:
        """Returns whether the process's loop has gone on since this was asked before."""
        try:
            beaten_ns = self._beat_path.stat().st_mtime_ns
        except FileNotFoundError:
            return False
        before_ns, self._beaten_ns = self._beaten_ns, beaten_ns
        return beaten_ns != before_ns

    def last_lines(self) -> list[str]:
        """Returns the end of the process's log."""
        text = self.log_path.read_text(encoding="utf-8", errors="replace")
        return text.splitlines()[-_LAST_LINES:]

    def terminate(self) -> None:
        """Asks the process to stop."""
        if self._popen.poll() is None:
            self._popen.terminate()

    def kill(self) -> None:
        """Ends the process at once."""
        if self._popen.poll() is None:
            self._popen.kill()

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
        self._beat_path.unlink(missing_ok=True)
        _log.info("%s: ended with status %d", self.spec.name, self._popen.returncode)


def set_aside(log: Path) -> None:
    """Renames a log to `NAME.1.log`, or the next number that is free; keeps the newest of those."""
    if not log.exists():
        return
    found = re.compile(rf"{re.escape(log.stem)}\.(\d+)\.log")
    numbers = sorted(
        int(match[1]) for path in log.parent.iterdir() if (match := found.fullmatch(path.name))
    )
    log.rename(log.with_suffix(f".{max(numbers, default=0) + 1}.log"))
    for number in numbers[: -(LOGS_KEPT - 1)]:
        log.with_suffix(f".{number}.log").unlink()
