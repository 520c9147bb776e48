"""Settings: one frozen struct per service, read once from defaults, a TOML file and flags.

Flags win over the file, the file over the defaults. An unknown key is refused with its path.
"""

from __future__ import annotations

import os
import re
import socket
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import msgspec

from gfm.core import BadInputError, ConfigError
from gfm.service.logs import LogFormat, LogLevel
from gfm.transport import Credentials, check_endpoints, default_endpoint, read_credentials
from gfm_wire import Role

_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")


class ServiceConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What every service may be told.

    Attributes:
        run: The run to join; runs that share a router don't meet.
        role: What it is to others, which its certificate names; a watcher may do least.
        connect: The router's endpoint; empty means this machine's, or none where `listen` is set.
        listen: Endpoint on which this process is itself the router; empty means it is a client.
        certs: Folder of certificates, as `gfm certs` makes it, by which all speak; empty for none.
        insecure: Whether anybody who reaches it may come in, where `listen` is set and there are no
            certificates.
        wait_s: How long to wait for the router at the start.
        name: Unique within the run; empty means made from host and process id.
        heartbeat_file: File that the service's loop touches twice a second; empty for none.
        sums_file: File of what earlier processes of this service counted, which its counters go on
            from, or a folder that has one for each service by its name; empty for none.
        log_level: Least severe event that is logged.
        log_format: Lines for people, or one JSON object per line.
    """

    role: ClassVar[Role] = Role.WATCHER

    run: str = "default"
    connect: str = ""
    listen: str = ""
    certs: str = ""
    insecure: bool = False
    wait_s: float = 30.0
    name: str = ""
    heartbeat_file: str = ""
    sums_file: str = ""
    log_level: LogLevel = "info"
    log_format: LogFormat = "text"

    def __post_init__(self) -> None:
        if self.name and not _NAME.fullmatch(self.name):
            raise ConfigError(
                f"name {self.name!r}: expected 1 to 64 letters, digits, dots, dashes or _"
            )
        if self.wait_s < 0:
            raise ConfigError(f"wait_s is {self.wait_s}, expected at least 0")
        check_endpoints(
            self.listen_endpoints,
            self.connect_endpoints,
            secure=bool(self.certs),
            insecure=self.insecure,
        )

    @property
    def listen_endpoints(self) -> tuple[str, ...]:
        """Where to listen as a router: one endpoint, or none."""
        return (self.listen,) if self.listen else ()

    @property
    def connect_endpoints(self) -> tuple[str, ...]:
        """Which router to join: one endpoint, or none where this process is the router."""
        if self.connect:
            return (self.connect,)
        return () if self.listen else (default_endpoint(secure=bool(self.certs)),)

    def credentials(self) -> Credentials | None:
        """Returns what this process shows of itself, a router's where it listens; None: nothing.

        Raises:
            BadInputError: they cannot be used.
        """
        if not self.certs:
            return None
        return read_credentials(Path(self.certs), Role.ROUTER if self.listen else self.role)


def unique_name(prog: str) -> str:
    """Returns a name that no other process of a run has."""
    host = re.sub(r"[^A-Za-z0-9.-]", "-", socket.gethostname())[:32]
    return f"{prog.removeprefix('gfm-')}-{host}-{os.getpid()}"


Config = TypeVar("Config", bound=msgspec.Struct)


def read_config(
    config_type: type[Config],
    path: Path | None,
    flags: Mapping[str, Any],
    section: str = "",
) -> Config:
    """Returns the settings of defaults, file and flags.

    Args:
        config_type: The struct to fill.
        path: A TOML file, or None.
        flags: Values that win over the file, by field name; a dot leads into a nested struct.
        section: The table of the file that counts, empty where there is none of that name; by
            default the whole file.

    Raises:
        BadInputError: the file cannot be read.
        ConfigError: a key is unknown, or a value of the wrong type or out of range.
    """
    settings = {} if path is None else read_toml(path)
    if section:
        settings = settings.get(section, {})
    for name, value in flags.items():
        _set(settings, name.split("."), value)
    try:
        return msgspec.convert(settings, config_type)
    except msgspec.ValidationError as exc:
        where = f"{path}, table {section}" if section else f"{path or 'settings'}"
        raise ConfigError(f"{where}: {exc}") from exc


def read_toml(path: Path) -> dict[str, Any]:
    """Returns what a TOML file says, over what the file says that it names as its `base`.

    A base stands beside its file and has none itself; tables are merged, all else is replaced.

    Raises:
        BadInputError: a file cannot be read.
        ConfigError: one is no TOML, or names a base that is none.
    """
    settings = _parsed(path)
    below = _beside(path, settings.pop("base", None))
    if below is None:
        return settings
    first = _parsed(below)
    if "base" in first:
        raise ConfigError(
            f"{below}: is the base of {path.name} and names one itself, expected none"
        )
    return _merged(first, settings)


def base_of(path: Path) -> Path | None:
    """Returns the file that a TOML file names as its `base`, or None.

    Raises:
        BadInputError, ConfigError: as `read_toml` does.
    """
    return _beside(path, _parsed(path).get("base"))


def _beside(path: Path, name: object) -> Path | None:
    if name is None:
        return None
    if not isinstance(name, str) or Path(name).name != name or name == path.name:
        raise ConfigError(f"{path}: base is {name!r}, expected the name of another file beside it")
    return path.with_name(name)


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(below)
    for name, value in above.items():
        here = merged.get(name)
        if isinstance(here, dict) and isinstance(value, dict):
            merged[name] = _merged(here, value)
        else:
            merged[name] = value
    return merged


def _parsed(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as exc:
        raise BadInputError(f"{path}: cannot be read: {exc.strerror}") from exc
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as exc:
        raise ConfigError(f"{path}: not TOML: {exc}") from exc


def _set(settings: dict[str, Any], path: list[str], value: object) -> None:
    for name in path[:-1]:
        settings = settings.setdefault(name, {})
    settings[path[-1]] = value


def differing(
    here: Mapping[str, Any], there: Mapping[str, Any], prefix: str = ""
) -> Iterator[tuple[str, object, object]]:
    """Yields the path of every setting that differs, and both values; "absent" stands for none."""
    for name in sorted(here.keys() | there.keys()):
        ours, theirs = here.get(name, "absent"), there.get(name, "absent")
        if isinstance(ours, dict) and isinstance(theirs, dict):
            yield from differing(ours, theirs, f"{prefix}{name}.")
        elif ours != theirs:
            yield f"{prefix}{name}", ours, theirs
