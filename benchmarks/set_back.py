"""Runs a service whose clock was set back: `python -m set_back --set-back-file FILE --service M`.

The file holds seconds, read once at the start; the wall clock of the process is so much behind.
Nothing else of the machine sees it, and no right to set a clock is needed.
"""

from __future__ import annotations

import argparse
import runpy
import sys
import time
from pathlib import Path


def main() -> None:
    """Sets the clock of this process back and becomes the service."""
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--set-back-file", type=Path, required=True)
    parser.add_argument("--service", required=True)
    asked, rest = parser.parse_known_args()
    text = asked.set_back_file.read_text(encoding="ascii") if asked.set_back_file.exists() else "0"
    behind_ns, now_ns = int(float(text) * 1e9), time.time_ns
    time.time_ns = lambda: now_ns() - behind_ns
    sys.argv = [asked.service, *rest]
    runpy.run_module(asked.service, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
