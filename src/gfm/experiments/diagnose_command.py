"""What `gfm diagnose` does: recordings and a model in, a verdict out."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.text import Text

from gfm.api.diagnosis import DiagnoseRequest, diagnosed
from gfm.api.folders import check_folder
from gfm.report import print_diagnosis


def diagnose_files(request: DiagnoseRequest, out: Path, answer: Console, progress: Console) -> None:
    """Reads, diagnoses, writes and prints.

    Args:
        request: What.
        out: Folder to write to.
        answer: Gets the verdict.
        progress: Told what is happening.

    Raises:
        BadInputError: something given cannot be used; nothing was written.
    """
    check_folder(out)
    diagnosis = diagnosed(request, partial(_say, progress, time.monotonic()))
    paths = diagnosis.save(out)
    print_diagnosis(answer, diagnosis.answer)
    for path in paths:
        answer.print(Text(str(path)), soft_wrap=True)


def _say(progress: Console, began_s: float, words: str) -> None:
    """Tells what is happening, and how many seconds after the beginning."""
    seconds = f"{time.monotonic() - began_s:6.1f} s"
    progress.print(Text(f"{seconds}  {words}", style="dim"), soft_wrap=True)
