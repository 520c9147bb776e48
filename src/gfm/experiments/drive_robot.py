"""The robot of `gfm drive`: one that is there, or a simulated one in processes of its own.

Shape letters: J joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gfm.core import Clock
from gfm.core.checks import Array
from gfm.envs.arm import CONTROL_PERIOD_S
from gfm.experiments.drive_request import DriveRequest
from gfm.launch import (
    RunAddress,
    Supervisor,
    SystemSpec,
    own_system,
    robot_processes,
    router_process,
    watching,
)
from gfm.launch.own_certs import certs_to_join
from gfm.transport import Transport
from gfm_wire import Role


@contextmanager
def robot_of(
    request: DriveRequest, clock: Clock, zero: Array
) -> Iterator[tuple[Transport, Callable[[], None] | None]]:
    """Yields a connection to the run of the robot that is asked for, and what to do while waiting.

    A simulated robot is started with its bridge, and stopped in the end.

    Args:
        request: What is asked for.
        clock: Of this process.
        zero: What the joints report where the published arm is at zero, rad, shape (J,): what is
            known of it, by which a bridge that is started here keeps its distances.

    Raises:
        BadInputError: the robot cannot be what is asked for.
        UnreachableError: no run answers.
    """
    if request.connect:
        certs = certs_to_join(request.connect, request.certs)
        address = RunAddress(run=request.run_name, endpoint=request.connect, certs=certs)
        with address.open(Role.DRIVER, name="drive") as transport:
            yield transport, None
        return
    with Supervisor(_system(request, zero), request.out / "logs", clock=clock) as supervisor:
        supervisor.start()
        with supervisor.spec.address.open(Role.DRIVER, name="drive") as transport:
            yield transport, watching(supervisor, clock)


def _system(request: DriveRequest, zero: Array) -> SystemSpec:
    folder = request.out.absolute()
    config = request.robot_config
    both = ("--clock", request.clock, "--task", request.task.removesuffix("_matching"))
    robot = (
        *(("--config", str(config.absolute())) if config else ()),
        *both,
        *("--hidden-effect", request.hidden_effect),
        *("--seed", str(request.seed), "--sealed", str(folder / "sealed.json")),
    )
    bridge = (
        *("--recordings", str(folder / "recordings")),
        *("--control-hz", f"{1.0 / CONTROL_PERIOD_S:g}"),
        *("--joint-zero-rad", *(f"{one:.9f}" for one in zero)),
        *both,
    )
    processes = (router_process(), *robot_processes(bridge, robot, request.robot))
    return own_system("drive", folder, processes)
