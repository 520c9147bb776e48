"""What `gfm diagnose` does: recordings and a model in, a verdict out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import final

from rich.console import Console
from rich.text import Text

from gfm.api.answer import Diagnosis
from gfm.api.diagnosis import DiagnoseRequest, diagnosed
from gfm.api.films.rerun_file import NAME, rerun_is_here
from gfm.api.folders import check_folder
from gfm.report import print_diagnosis


def diagnose_files(
    request: DiagnoseRequest, out: Path, answer: Console, progress: Console, *, film: bool = True
) -> None:
    """Reads, diagnoses, writes and prints.

    Args:
        request: What.
        out: Folder to write to.
        answer: Gets the verdict.
        progress: Told what is happening.
        film: Whether the report shows robot and models moving where something was corrected; with
            the extra `rerun` there is a file for that, too.

    Raises:
        BadInputError: something given cannot be used; nothing was written.
    """
    check_folder(out)
    say = Progress(progress)
    diagnosis = diagnosed(request, say)
    paths = diagnosis.save(out)
    print_diagnosis(answer, diagnosis.answer)
    _tell(answer, paths)
    if film and diagnosis.effects:  # last: nothing about a film may cost an answer
        say("drawing robot and models")
        with ThreadPoolExecutor(1) as beside:  # drawn by a process of its own
            drawn = beside.submit(diagnosis.film)
            _tell(answer, _rerun_file(diagnosis, out))
            diagnosis.save(out, film=drawn.result())


def _tell(answer: Console, paths: Sequence[Path]) -> None:
    for path in paths:
        answer.print(Text(str(path)), soft_wrap=True)


def _rerun_file(diagnosis: Diagnosis, out: Path) -> tuple[Path, ...]:
    """Writes the motion for Rerun where that is installed; returns where it is."""
    return (diagnosis.save_motion(out / NAME),) if rerun_is_here() else ()


@final
class Progress:
    """Tells what is happening, and how many seconds after the beginning; nothing twice running."""

    def __init__(self, console: Console) -> None:
        self._console, self._began_s, self._last = console, time.monotonic(), ""

    def __call__(self, words: str) -> None:
        """Prints a line."""
        if words != self._last:
            seconds = f"{time.monotonic() - self._began_s:6.1f} s"
            self._console.print(Text(f"{seconds}  {words}", style="dim"), soft_wrap=True)
        self._last = words
