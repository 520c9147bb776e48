"""The router through which all processes of a run speak, as a process that does nothing else.

No service's work, however long, keeps others from hearing one another then.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import final

from typing_extensions import override

from gfm.core import Clock, Status
from gfm.service import Service, ServiceConfig, make_parser, make_status, service_main
from gfm.transport import Transport


@final
class RouterService(Service):
    """Only says that it is there: zenoh routes by itself."""

    def __init__(self, name: str) -> None:
        self._name = name

    @override
    def step(self) -> bool:
        return False

    @override
    def status(self) -> Status:
        return make_status("router", self._name, note="routing")

    @override
    def close(self) -> None:
        """Nothing to finish."""


def build(config: ServiceConfig, _transport: Transport, _clock: Clock) -> Service:
    """Returns the service that the settings describe."""
    return RouterService(config.name)


def main(argv: Sequence[str] | None = None) -> int:
    """Routes until told to stop: the process that a supervisor starts."""
    parser = make_parser("gfm-router", "Routes what all processes of a run say.", listens=True)
    return service_main(parser, ServiceConfig, build, argv)


if __name__ == "__main__":
    sys.exit(main())
