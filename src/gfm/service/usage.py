"""What this process uses of its machine."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

_PROC = Path("/proc/self")


class _MallInfo2(ctypes.Structure):
    """glibc's `struct mallinfo2`, of which two fields count here: bytes that are handed out."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    )


def _heap() -> dict[str, float]:
    """Returns `heap_mib`, what malloc has handed out; nothing without glibc 2.33 or newer."""
    try:
        mallinfo2 = ctypes.CDLL(None).mallinfo2
    except (AttributeError, OSError, TypeError):
        return {}
    mallinfo2.restype = _MallInfo2
    told = mallinfo2()
    return {"heap_mib": (told.uordblks + told.hblkhd) / 2**20}


def process_usage() -> dict[str, float]:
    """Returns what this process uses; nothing where the system does not tell.

    `memory_mib` is resident, `open_files` are handles. `heap_mib` and `python_blocks` grow with
    what is held alone: memory that was freed and kept for later is not among them.
    """
    try:
        resident_pages = int((_PROC / "statm").read_text(encoding="ascii").split()[1])
        open_files = sum(1 for _ in (_PROC / "fd").iterdir())
    except OSError:
        return {}
    return {
        "memory_mib": resident_pages * os.sysconf("SC_PAGE_SIZE") / 2**20,
        "open_files": float(open_files),
        "python_blocks": float(sys.getallocatedblocks()),
        **_heap(),
    }
