"""A campaign on a task that is made by a process of its own, beside what else a run does."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import final

from rich.console import Console

from gfm.core import Clock
from gfm.experiments.transfer import TransferRequest, transfer
from gfm.report.transfer import Transfer

_LOOK_NS, _GRACE_S = 500_000_000, 10.0


@final
class TaskBeside:
    """Closes the loop on a task in a process that ends with `close`, or with this one.

    Args:
        request: What is asked for; a simulated robot that hides what a file says.
        log: Where the process writes what it does.
        clock: To wait by.
    """

    def __init__(self, request: TransferRequest, log: Path, clock: Clock) -> None:
        self._request, self._log, self._clock = request, log, clock
        self._popen: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Starts the process; in a session of its own, so that Ctrl-C reaches this one alone."""
        with self._log.open("wb") as log:
            self._popen = subprocess.Popen(
                [sys.executable, "-m", "gfm.launch.child", "gfm.cli", *_words(self._request)],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def result(self, say: Callable[[str], None]) -> Transfer:
        """Waits for the process, and returns what came of the campaign.

        A step that the process did not come to is made here, and says why it cannot be made.

        Args:
            say: Told what the process does, now and then.

        Raises:
            GfmError: of `transfer`.
        """
        while self._popen is not None and self._popen.poll() is None:
            say(self._last_words())
            self._clock.sleep_until_ns(self._clock.now_ns() + _LOOK_NS)
        with self._log.open("a") as log:
            return transfer(self._request, Console(file=log), self._clock, lambda: False)

    def close(self) -> None:
        """Ends the process where it still runs."""
        if self._popen is None:
            return
        self._popen.terminate()
        try:
            self._popen.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            self._popen.kill()
            self._popen.wait()
        if self._popen.stdin is not None:
            self._popen.stdin.close()

    def _last_words(self) -> str:
        """Returns the last line of the log that is not drawn of lines alone."""
        lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines()
        told = (line.strip(" ─") for line in reversed(lines) if any(map(str.isalnum, line)))
        return next(told, "")


def _words(request: TransferRequest) -> tuple[str, ...]:
    """Returns the command that makes the same campaign."""
    drive = request.drive
    return (
        *("transfer", "--task", drive.task.removesuffix("_matching")),
        *("--robot-config", str(drive.robot_config), "--seed", str(drive.seed)),
        *("--goals", str(drive.goals), "--trials", str(drive.trials), "--out", str(drive.out)),
        *("--minutes", f"{request.minutes:g}", "--air-seconds", f"{request.air_s:g}"),
        *("--treatments", *request.treatments),
    )
