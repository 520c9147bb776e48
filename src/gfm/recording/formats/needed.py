"""Packages that only some formats need."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from gfm.core.extras import needs


def needed(module: str, what: str) -> ModuleType:
    """Returns a module of an optional package.

    Args:
        module: Its full name.
        what: What it is for, in the plural, for the message.

    Raises:
        ConfigError: the package is not installed.
    """
    with needs(f"{what} need", module.partition(".")[0], "formats"):
        return import_module(module)
