"""Packages that only a part of the house needs, and which extra installs them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType

from gfm.core.errors import ConfigError


@contextmanager
def needs(what: str, package: str, extra: str) -> Iterator[None]:
    """Tells which extra is missing where a package cannot be imported within.

    Args:
        what: What needs it, with its verb: "certificates need".
        package: Its name as it is imported.
        extra: Of gfm-sim2real, that installs it.

    Raises:
        ConfigError: the package is not installed. Another one that is missing is nobody's
            configuration, and stays the error that it is.
    """
    try:
        yield
    except ModuleNotFoundError as exc:
        if exc.name is None or exc.name.partition(".")[0] != package:
            raise
        advice = f"expected it: pip install 'gfm-sim2real[{extra}]'"
        raise ConfigError(f"{what} the package {package}, not installed; {advice}") from exc


def needed(module: str, what: str, extra: str) -> ModuleType:
    """Returns a module of an optional package.

    Args:
        module: Its full name.
        what: What needs it, with its verb.
        extra: Of gfm-sim2real, that installs it.

    Raises:
        ConfigError: the package is not installed.
    """
    with needs(what, module.partition(".")[0], extra):
        return import_module(module)
