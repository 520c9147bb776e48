"""Certificates for tests: made once per process, and valid for the day."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from gfm.launch.certs import make_certificates


def certificates(folder: Path) -> Path:
    """Returns `folder`, with certificates of every role."""
    list(make_certificates(folder, (), days=1, now=datetime.now(UTC)))
    return folder
