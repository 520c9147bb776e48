"""Whether this host's service answers: `python -m gfm.launch.health ROLE`, for containers.

A process that runs may still be stuck; one that says how it is, through the router and in time, is
neither stuck nor cut off. Exit status 0: it answers. 1: it does not, or the router does not.
"""

from __future__ import annotations

import argparse
import socket
import sys
from collections.abc import Sequence

from gfm.core import GfmError, Status
from gfm.launch.spec import START_ORDER
from gfm.service import DEFAULT_ENDPOINT, exit_status
from gfm.transport import Transport, ZenohTransport
from gfm_wire import StatusRequest


class UnhealthyError(GfmError):
    """A service does not answer."""

    def __init__(self, role: str, host: str, timeout_s: float) -> None:
        super().__init__(f"no {role} of host {host} answered within {timeout_s:g} s")


def health(transport: Transport, role: str, *, host: str, timeout_s: float) -> Status:
    """Returns what the service of one role on one host says of itself.

    Raises:
        UnhealthyError: it did not answer in time.
    """
    for answer in transport.survey(f"status/{role}/*", StatusRequest(), timeout_s=timeout_s):
        if isinstance(answer, Status) and answer.host == host:
            return answer
    raise UnhealthyError(role, host, timeout_s)


def main(argv: Sequence[str] | None = None) -> int:
    """Asks, and says what was answered."""
    parser = argparse.ArgumentParser(
        "python -m gfm.launch.health",
        description="Asks the service of this host how it is, through the run's router.",
    )
    parser.add_argument("role", choices=START_ORDER, help="of the service")
    parser.add_argument(
        "--connect", default=DEFAULT_ENDPOINT, metavar="ENDPOINT", help="(default: %(default)s)"
    )
    parser.add_argument("--run", default="default", metavar="NAME", help="(default: %(default)s)")
    parser.add_argument(
        "--timeout-s", type=float, default=2.0, help="for each step (default: %(default)s)"
    )
    arguments = parser.parse_args(argv)

    def ask() -> None:
        timeout_s = arguments.timeout_s
        with ZenohTransport.open(
            run=arguments.run, connect=[arguments.connect], timeout_s=timeout_s
        ) as transport:
            host = socket.gethostname()
            status = health(transport, arguments.role, host=host, timeout_s=timeout_s)
        sys.stdout.write(f"{status.name}: {status.note or 'running'}\n")

    return exit_status(ask)


if __name__ == "__main__":
    sys.exit(main())
