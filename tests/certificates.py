"""Certificates for tests: made once per process, and valid for the day."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

from gfm.launch.certs import make_certificates


def certificates(folder: Path, age: timedelta = timedelta()) -> Path:
    """Returns `folder`, with certificates of every role, made so long ago."""
    list(make_certificates(folder, (), days=1, now=datetime.now(UTC) - age))
    return folder
