"""Packages that only some formats need."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from gfm.core import ConfigError


def needed(module: str, what: str) -> ModuleType:
    """Returns a module of an optional package.

    Args:
        module: Its full name.
        what: What it is for, in the plural, for the message.

    Raises:
        ConfigError: the package is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as exc:
        package = module.partition(".")[0]
        advice = "expected it: pip install 'gfm-sim2real[formats]'"
        raise ConfigError(f"{what} need the package {package}, not installed; {advice}") from exc
