"""Where a run is, and how a command joins it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gfm.core import BadInputError, UnreachableError
from gfm.transport import Credentials, default_endpoint, read_credentials
from gfm_wire import Role

if TYPE_CHECKING:
    from gfm.transport import ZenohTransport


@dataclass(frozen=True, kw_only=True)
class RunAddress:
    """Where a run is.

    Attributes:
        run: Its name.
        endpoint: Its router; empty means this machine's.
        certs: Folder of certificates, as `gfm certs` makes it; empty for none.
    """

    run: str
    endpoint: str = ""
    certs: str = ""

    @property
    def router(self) -> str:
        """The router's endpoint."""
        return self.endpoint or default_endpoint(secure=bool(self.certs))

    @property
    def flags(self) -> tuple[str, ...]:
        """The flags of a command that joins this run."""
        certs = ("--certs", self.certs) if self.certs else ()
        return ("--connect", self.router, "--run", self.run, *certs)

    def credentials(self, role: Role) -> Credentials | None:
        """Returns what a process of a role shows of itself; None without certificates.

        Raises:
            BadInputError: they cannot be used.
        """
        return read_credentials(Path(self.certs), role) if self.certs else None

    def open(self, role: Role, *, name: str = "", timeout_s: float = 10.0) -> ZenohTransport:
        """Returns a connection to the run, as a client.

        Raises:
            BadInputError, UnreachableError: as `ZenohTransport.open` does.
        """
        from gfm.transport import ZenohTransport  # commands that join no run need no zenoh

        return ZenohTransport.open(
            run=self.run,
            name=name,
            connect=(self.router,),
            timeout_s=timeout_s,
            credentials=self.credentials(role),
        )

    def watch(self, *, name: str = "", timeout_s: float) -> ZenohTransport:
        """Returns a watcher's connection to the run.

        Raises:
            BadInputError: nobody is there.
        """
        try:
            return self.open(Role.WATCHER, name=name, timeout_s=timeout_s)
        except UnreachableError as exc:
            raise BadInputError(
                f"no system at {self.router}: start one with `gfm up`, or name another with "
                "--connect, and its certificates with --certs"
            ) from exc
