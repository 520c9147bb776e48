"""What this process uses of its machine."""

from __future__ import annotations

import os
from pathlib import Path

_PROC = Path("/proc/self")


def process_usage() -> dict[str, float]:
    """Returns `memory_mib` (resident) and `open_files`; nothing where the system does not tell."""
    try:
        resident_pages = int((_PROC / "statm").read_text(encoding="ascii").split()[1])
        open_files = sum(1 for _ in (_PROC / "fd").iterdir())
    except OSError:
        return {}
    return {
        "memory_mib": resident_pages * os.sysconf("SC_PAGE_SIZE") / 2**20,
        "open_files": float(open_files),
    }
