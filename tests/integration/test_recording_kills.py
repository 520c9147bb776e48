"""A recording process that is killed leaves everything readable, and nothing written over."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "recording_kills.py"


@pytest.mark.slow
def test_kills_leave_every_recording_readable() -> None:
    done = subprocess.run(
        [sys.executable, str(BENCHMARK), "--kills", "40", "--seed", "7"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("40 kills, seed 7")
