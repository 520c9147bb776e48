"""The router through which all processes of a run speak, as a process that does nothing else.

No service's work, however long, keeps others from hearing one another then.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, final

from typing_extensions import override

from gfm.core import Clock, Status
from gfm.service import Service, ServiceConfig, make_parser, make_status, service_main
from gfm_wire import Role

if TYPE_CHECKING:
    from gfm.transport import ZenohTransport


class RouterConfig(ServiceConfig, frozen=True, kw_only=True):
    """Settings of the router."""

    role: ClassVar[Role] = Role.ROUTER


@final
class RouterService(Service):
    """Only says that it is there, and who else: zenoh routes by itself."""

    def __init__(
        self,
        name: str,
        connected: Callable[[], Mapping[str, int]],
        dropped: Callable[[], int],
    ) -> None:
        """Is ready at once.

        Args:
            name: Unique within the run.
            connected: Returns how many connections there are, by role.
            dropped: Returns how many messages were not let through so far.
        """
        self._name = name
        self._connected = connected
        self._dropped = dropped

    @override
    def step(self) -> bool:
        return False

    @override
    def status(self) -> Status:
        gauges = {f"connected_{role}": float(n) for role, n in self._connected().items()}
        counters = {"dropped_messages": self._dropped()}
        return make_status("router", self._name, counters=counters, gauges=gauges, note="routing")

    @override
    def close(self) -> None:
        """Nothing to finish."""


def build(config: RouterConfig, transport: ZenohTransport, _clock: Clock) -> Service:
    """Returns the service that the settings describe."""
    from gfm.transport.drops import Drops  # zenoh is loaded by whoever opens a transport

    drops = Drops()
    return RouterService(config.name, transport.connected, lambda: drops.count)


def main(argv: Sequence[str] | None = None) -> int:
    """Routes until told to stop: the process that a supervisor starts."""
    parser = make_parser("gfm-router", "Routes what all processes of a run say.", listens=True)
    return service_main(parser, RouterConfig, build, argv)


if __name__ == "__main__":
    sys.exit(main())
