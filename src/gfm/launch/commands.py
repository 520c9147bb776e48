"""The commands `gfm up`, `gfm status` and `gfm router`."""

from __future__ import annotations

import argparse
import json
import logging
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from rich.console import Console

from gfm.core import (
    BadInputError,
    Clock,
    CommandKind,
    ConfigError,
    MonotonicClock,
    Status,
)
from gfm.launch.address import RunAddress
from gfm.launch.flags import add_endpoint, address_of, router_address_of
from gfm.launch.keeper import Keeper
from gfm.launch.own_certs import OWN_CERTS, own_certificates
from gfm.launch.router import RouterConfig
from gfm.launch.router import build as build_router
from gfm.launch.spec import (
    ENGINES,
    SystemSpec,
    actor_processes,
    learner_process,
    replay_process,
    robot_processes,
    router_process,
    sequence_length_of,
    settings_of,
)
from gfm.launch.supervision import SupervisionConfig
from gfm.launch.supervisor import Supervisor
from gfm.launch.survey import (
    keeper_statuses,
    missing_of,
    status_table,
    statuses,
    summary,
    summary_line,
)
from gfm.service import StopSignal, read_config, serve, start_logging
from gfm.service.config import unique_name
from gfm.service.environment_flags import add_environment_flags
from gfm_wire import Role

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_log = logging.getLogger(__name__)

_UP = """\
Starts a learning system as processes of this machine: router, replay, learner, actors and, with
--robot, a simulated robot with its bridge. What dies or hangs is started again; what dies again and
again is given up, and the last of its kind ends the system. Ctrl-C ends all of them, in order.
"""
_STATUS = "Asks every service of a running system how it is, and says so, and who is missing."
_ROUTER = "Runs the router that services connect to, for systems that `gfm up` does not start."
_CHECK_NS = 200_000_000
_TELL_NS = 10_000_000_000
_TELL_TIMEOUT_S = 0.5
_STATUS_TIMEOUT_S = 3.0


def add_up_parser(subparsers: Subparsers) -> None:
    """Adds `gfm up`."""
    parser = subparsers.add_parser(
        "up",
        help="start replay, learner and actors on this machine",
        description=_UP,
        argument_default=argparse.SUPPRESS,
    )
    add_environment_flags(parser)
    parser.add_argument(
        "--actors", type=int, default=2, metavar="N", help="actor processes (default: %(default)s)"
    )
    parser.add_argument(
        "--robot", choices=("none", *ENGINES), default="none", help="start a simulated robot"
    )
    parser.add_argument("--seed", type=int, default=0, help="(default: %(default)s)")
    parser.add_argument(
        "--dir",
        type=Path,
        default=None,
        metavar="DIR",
        help="logs, checkpoints, recordings (default: runs/up-TIME)",
    )
    parser.add_argument(
        "--config-dir",
        type=Path,
        default=None,
        metavar="DIR",
        help="has actor.toml, learner.toml, replay.toml ... with settings of the services, and "
        "supervisor.toml for what dies or hangs",
    )
    add_endpoint(parser, "--listen", "where the router listens")
    parser.set_defaults(run=run_up)


def run_up(arguments: argparse.Namespace) -> int:
    """Starts a system and watches it until it is told to stop."""
    _check_environment(vars(arguments).get("env"))
    start_logging("info")
    clock = MonotonicClock()
    stopped = StopSignal()
    stopped.install()
    directory = arguments.dir or Path("runs") / time.strftime("up-%Y%m%d-%H%M%S")
    system = _system(arguments, directory)
    _check_credentials(system)
    config = _supervision(arguments.config_dir)
    _log.info("supervision: %s", msgspec.json.encode(config).decode())
    _check_models(vars(arguments).get("environment.models", {}))
    _make_own(system.address)
    with Supervisor(system, directory / "logs", clock=clock) as supervisor:
        supervisor.start(stopped)
        _log.info("running; logs in %s", directory / "logs")
        _log.info("%s", _about_certificates(system.certs))
        _log.info("ask it: gfm status %s", shlex.join(system.address.flags))
        if not stopped():
            _keep(supervisor, Keeper(supervisor, config, clock), clock, stopped)
    return 0


def _check_environment(name: str | None) -> None:
    """Raises UnknownNameError before anything is started; without a name settings tell."""
    from gfm.envs.registry import check_name

    if name is not None:
        check_name(name)


def _check_models(paths: Mapping[CommandKind, str]) -> None:
    """Refuses models that cannot be used before anything is started; says what is beside them."""
    if paths:
        from gfm.service.model_files import read_robot  # loads mujoco

        read_robot(paths, partial(_log.info, "%s"))


def _keep(
    supervisor: Supervisor, keeper: Keeper, clock: Clock, stopped: Callable[[], bool]
) -> None:
    told_ns = clock.now_ns()
    while not stopped():
        keeper.step()
        if clock.now_ns() - told_ns > _TELL_NS:
            found = statuses(supervisor.transport, timeout_s=_TELL_TIMEOUT_S)
            _log.info("%s", "; ".join((summary_line(summary(found)), *keeper.missing)))
            told_ns = clock.now_ns()
        clock.sleep_until_ns(clock.now_ns() + _CHECK_NS)


def _supervision(folder: Path | None) -> SupervisionConfig:
    path = None if folder is None else folder / "supervisor.toml"
    return read_config(SupervisionConfig, path if path is not None and path.exists() else None, {})


def _system(arguments: argparse.Namespace, directory: Path) -> SystemSpec:
    if arguments.actors < 1:
        raise ConfigError(f"--actors is {arguments.actors}, expected at least 1")
    settings = arguments.config_dir
    if settings is not None and not settings.is_dir():
        raise BadInputError(f"--config-dir {settings}: expected a folder")
    env = environment_arguments(arguments)
    checkpoints = ("--checkpoint-dir", str(directory / "checkpoints"))
    replay = ("--folder", str(directory / "replay"))
    processes = [
        router_process(),
        replay_process(
            (*settings_of(settings, "replay"), *replay),
            sequence_length_of(settings and settings / "actor.toml"),
        ),
        learner_process((*settings_of(settings, "learner"), *env, *checkpoints)),
        *actor_processes(arguments.actors, arguments.seed, (*settings_of(settings, "actor"), *env)),
    ]
    if arguments.robot != "none":
        recordings = ("--recordings", str(directory / "recordings"))
        bridge = (*settings_of(settings, "robot_bridge"), *recordings)
        processes += robot_processes(bridge, settings_of(settings, "robot"), arguments.robot)
    address = router_address_of(arguments)
    return SystemSpec(
        run=address.run,
        endpoint=address.router,
        processes=tuple(processes),
        certs=address.certs,
        insecure=arguments.insecure,
    )


def _check_credentials(system: SystemSpec) -> None:
    """Refuses certificates that somebody named and that a process of the system could not use."""
    if system.certs == str(OWN_CERTS):
        return  # they are made, and looked at, where all else is well
    for role in (*(process.role for process in system.processes), Role.SUPERVISOR):
        system.address.credentials(Role(role))


def _about_certificates(certs: str) -> str:
    if not certs:
        return "no certificates: whoever reaches the router may read, publish and command"
    return f"certificates in {certs}, for who joins; --insecure goes without"


def _make_own(address: RunAddress) -> None:
    if address.certs == str(OWN_CERTS):
        own_certificates(OWN_CERTS)


def environment_arguments(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Returns the environment flags that were given, to be passed on to actors and learner."""
    given = vars(arguments)
    env = ("--env", given["env"]) if "env" in given else ()
    models = [f"{kind}={path}" for kind, path in given.get("environment.models", {}).items()]
    numbers = [
        word
        for name in ("horizon", "control_period_s", "joint_nm")
        if (number := given.get(f"environment.{name}")) is not None
        for word in (f"--{name.replace('_', '-')}", str(number))
    ]
    return (
        *env,
        *_repeated("--model", models),
        *_repeated("--recording", given.get("environment.recordings", ())),
        *_repeated("--forced-joint", given.get("environment.forced_joints", ())),
        *_repeated("--scale", [str(x) for x in given.get("environment.scale", ())]),
        *numbers,
    )


def _repeated(flag: str, values: Iterable[str]) -> tuple[str, ...]:
    return tuple(word for value in values for word in (flag, value))


def add_status_parser(subparsers: Subparsers) -> None:
    """Adds `gfm status`."""
    parser = subparsers.add_parser(
        "status", help="ask a running system how it is", description=_STATUS
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    add_endpoint(parser, "--connect", "the system's router")
    parser.set_defaults(run=run_status)


def run_status(arguments: argparse.Namespace) -> int:
    """Prints what a running system says of itself."""
    found, kept = _answers(address_of(arguments))
    missing = missing_of(found, kept)
    sums = summary(found, missing)
    if arguments.json:
        sys.stdout.write(json.dumps(sums, indent=2) + "\n")
    else:
        console = Console()
        console.print(status_table(found, missing))
        console.print(summary_line(sums), highlight=False)
    return 0


def _answers(address: RunAddress) -> tuple[list[Status], list[Status]]:
    """Returns what services say, and what their keeper says of them."""
    with address.watch(timeout_s=_STATUS_TIMEOUT_S) as transport:
        found = statuses(transport, timeout_s=_STATUS_TIMEOUT_S)
        kept = keeper_statuses(transport, timeout_s=_STATUS_TIMEOUT_S)
    if not found and not kept:
        raise BadInputError(
            f"no service of run {address.run!r} at {address.router}; name another with --run"
        )
    return found, kept


def add_router_parser(subparsers: Subparsers) -> None:
    """Adds `gfm router`."""
    parser = subparsers.add_parser(
        "router", help="run a router that services connect to", description=_ROUTER
    )
    add_endpoint(parser, "--listen", "where to listen")
    parser.add_argument(
        "--heartbeat-file", default="", metavar="FILE", help="touch this while all is well"
    )
    parser.set_defaults(run=run_router)


def run_router(arguments: argparse.Namespace) -> int:
    """Routes until told to stop."""
    address = router_address_of(arguments)
    config = RouterConfig(
        run=address.run,
        listen=address.router,
        certs=address.certs,
        insecure=arguments.insecure,
        name=unique_name("router"),
        heartbeat_file=arguments.heartbeat_file,
    )
    _make_own(address)
    serve(config, build_router)
    return 0
