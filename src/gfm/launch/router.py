"""A router and nothing else, for systems whose hub is no service (containers, several hosts)."""

from __future__ import annotations

from typing import final

from typing_extensions import override

from gfm.core import Status
from gfm.service import Service, make_status


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
