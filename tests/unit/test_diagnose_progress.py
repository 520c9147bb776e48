"""What is told while a diagnosis goes on."""

from __future__ import annotations

from io import StringIO

from rich.console import Console

from gfm.experiments.diagnose_command import Progress


def test_what_happens_several_times_running_is_told_once() -> None:
    written = StringIO()
    progress = Progress(Console(file=written))
    for words in ("fitting", "the time is over", "the time is over", "measuring"):
        progress(words)
    told = [line.split("s  ")[1] for line in written.getvalue().splitlines()]
    assert told == ["fitting", "the time is over", "measuring"]
