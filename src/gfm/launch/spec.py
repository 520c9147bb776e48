"""Which processes make a system: declared as values, started by the supervisor."""

from __future__ import annotations

import socket
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gfm.core import SEQUENCE_LENGTH, ConfigError
from gfm.launch.address import RunAddress
from gfm.service.config import read_toml
from gfm.transport import check_endpoints

START_ORDER = ("router", "replay", "learner", "robot", "robot_bridge", "actor")
"""Whoever is asked comes before whoever asks."""

STOP_ORDER = ("actor", "learner", "robot_bridge", "robot", "replay", "router")
"""Actors first, so that nothing new arises; the learner while it can still be asked; the bridge
before the robot, so that it can hold it; last the hub through which everybody speaks."""

ENGINES = {"sim": "mujoco", "drake": "drake"}
"""Simulated robots by the name that commands have for them, with the engine of each."""

LOCKSTEP = ("--clock", "lockstep")
"""What a simulated robot and its bridge are both told where time shall pass with commands only."""

_LENGTH = "sequence_length"

_MODULES = {
    "router": "gfm.launch.router",
    "replay": "gfm_replay",
    "learner": "gfm_learner",
    "actor": "gfm_actor",
    "robot_bridge": "gfm_robot_bridge",
    "robot": "gfm_robot_bridge.simulated",
}


@dataclass(frozen=True, kw_only=True)
class ProcessSpec:
    """One process.

    Attributes:
        role: One of START_ORDER; the service answers under `status/<role>/<name>`.
        name: Unique within the system.
        module: What `python -m` runs.
        arguments: Its command line, without those that join it to the system.
        hub: Whether this process is the router of the others.
    """

    role: str
    name: str
    module: str
    arguments: tuple[str, ...] = ()
    hub: bool = False

    def __post_init__(self) -> None:
        if self.role not in START_ORDER:
            raise ConfigError(f"role {self.role!r}: expected one of {', '.join(START_ORDER)}")


@dataclass(frozen=True, kw_only=True)
class SystemSpec:
    """The processes of one run on this machine.

    Attributes:
        run: The run's name.
        endpoint: Where the hub listens and everybody else connects.
        processes: Exactly one of them is the hub.
        certs: Folder of certificates by which all of them speak; empty for none.
        insecure: Whether anybody who reaches the hub may come in: without certificates that must
            be meant.
    """

    run: str
    endpoint: str
    processes: tuple[ProcessSpec, ...]
    certs: str = ""
    insecure: bool = False

    def __post_init__(self) -> None:
        names = [process.name for process in self.processes]
        if len(set(names)) != len(names):
            raise ConfigError(f"processes {', '.join(names)}: expected different names")
        hubs = [process.name for process in self.processes if process.hub]
        if len(hubs) != 1:
            raise ConfigError(f"hubs {', '.join(hubs) or 'none'}: expected exactly one")
        check_endpoints((self.endpoint,), (), secure=bool(self.certs), insecure=self.insecure)

    @property
    def address(self) -> RunAddress:
        """Where the run is."""
        return RunAddress(run=self.run, endpoint=self.endpoint, certs=self.certs)

    def arguments(self, process: ProcessSpec) -> tuple[str, ...]:
        """Returns the whole command line of a process of this system."""
        certs = ("--certs", self.certs) if self.certs else ()
        insecure = ("--insecure",) if self.insecure and process.hub else ()
        joining = ("--listen" if process.hub else "--connect", self.endpoint, *certs, *insecure)
        return ("--run", self.run, *joining, "--name", process.name, *process.arguments)


def in_order(processes: Iterable[ProcessSpec], roles: Sequence[str]) -> list[ProcessSpec]:
    """Returns processes sorted by their roles' places in `roles`."""
    return sorted(processes, key=lambda process: roles.index(process.role))


def free_endpoint(*, secure: bool = False) -> str:
    """Returns a loopback endpoint that was free a moment ago; a secure one needs certificates."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{'tls' if secure else 'tcp'}/127.0.0.1:{probe.getsockname()[1]}"


def router_process() -> ProcessSpec:
    """Returns the hub: a process that does nothing but route."""
    return _process("router", "router", (), hub=True)


def replay_process(
    arguments: Iterable[str] = (), sequence_length: int = SEQUENCE_LENGTH
) -> ProcessSpec:
    """Returns the replay service.

    Args:
        arguments: Of its command line.
        sequence_length: Transitions of the actors' sequences: whoever comes first with another
            number keeps nobody out.
    """
    return _process("replay", "replay", ("--sequence-length", str(sequence_length), *arguments))


def sequence_length_of(path: Path | None, section: str = "") -> int:
    """Returns how long an actor's sequences are.

    Args:
        path: TOML file of its settings; None, or none there: the default.
        section: The table of that file which has them; empty: all of it.
    """
    if path is None or not path.exists():
        return SEQUENCE_LENGTH
    settings = read_toml(path)
    return int((settings.get(section, {}) if section else settings).get(_LENGTH, SEQUENCE_LENGTH))


def learner_process(arguments: Iterable[str] = ()) -> ProcessSpec:
    """Returns the learner; the arguments say for which environment."""
    return _process("learner", "learner", arguments)


def actor_processes(
    count: int, seed: int, arguments: Iterable[str] = ()
) -> tuple[ProcessSpec, ...]:
    """Returns `count` actors with different seeds; the arguments say in which environment."""
    shared = tuple(arguments)
    return tuple(
        _process("actor", f"actor-{i}", (*shared, "--seed", str(seed + i))) for i in range(count)
    )


def robot_processes(
    bridge_arguments: Iterable[str] = (), robot_arguments: Iterable[str] = (), robot: str = "sim"
) -> tuple[ProcessSpec, ...]:
    """Returns a simulated robot, one of ENGINES, and the bridge to it, for which all are alike."""
    engine = ("--engine", ENGINES[robot])
    return (
        _process("robot", "robot", (*robot_arguments, *engine)),
        _process("robot_bridge", "robot-bridge", ("--robot", "sim", *bridge_arguments)),
    )


def settings_of(directory: Path | None, role: str) -> tuple[str, ...]:
    """Returns the flags that make a service read `<directory>/<role>.toml`, where that exists."""
    path = None if directory is None else directory / f"{role}.toml"
    return ("--config", str(path)) if path is not None and path.exists() else ()


def _process(role: str, name: str, arguments: Iterable[str], *, hub: bool = False) -> ProcessSpec:
    return ProcessSpec(
        role=role, name=name, module=_MODULES[role], arguments=tuple(arguments), hub=hub
    )
