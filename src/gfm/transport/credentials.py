"""Who a process is to the others: a key and certificates in files, one folder per role.

DIR/ROLE/key.pem          the role's private key
DIR/ROLE/certificate.pem  says that whoever has that key has this role
DIR/ROLE/authority.pem    whose certificates are believed
"""

from __future__ import annotations

import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

from gfm.core import BadInputError
from gfm.transport.endpoints import host_and_port
from gfm_wire import Role

KEY, CERTIFICATE, AUTHORITY = "key.pem", "certificate.pem", "authority.pem"

_PROBE_S = 0.5


@dataclass(frozen=True, kw_only=True)
class Credentials:
    """What a process shows of itself, and whom it believes.

    Attributes:
        role: Its role, which its certificate names.
        folder: Has its key and certificates.
    """

    role: Role
    folder: Path

    def context(self) -> ssl.SSLContext:
        """Returns what a client needs to connect by TLS.

        Raises:
            ssl.SSLError: a file is no certificate or key, or the key is of another certificate.
        """
        context = ssl.create_default_context(cafile=self.folder / AUTHORITY)
        context.load_cert_chain(self.folder / CERTIFICATE, self.folder / KEY)
        return context

    def settings(self, *, listening: bool) -> dict[str, object]:
        """Returns zenoh's `transport/link/tls` section, for the side that listens or connects."""
        side = "listen" if listening else "connect"
        return {
            "root_ca_certificate": str(self.folder / AUTHORITY),
            f"{side}_certificate": str(self.folder / CERTIFICATE),
            f"{side}_private_key": str(self.folder / KEY),
            "enable_mtls": True,
            "close_link_on_expiration": True,
        }


def read_credentials(directory: Path, role: Role) -> Credentials:
    """Returns the credentials of a role.

    Args:
        directory: Has a folder for the role.
        role: Who the process is.

    Raises:
        BadInputError: a file is missing, cannot be read, or does not belong to the others.
    """
    credentials = Credentials(role=role, folder=directory / role)
    for name in (KEY, CERTIFICATE, AUTHORITY):
        path = credentials.folder / name
        try:
            path.read_bytes()
        except OSError as exc:
            raise BadInputError(
                f"{path}: {exc.strerror}; expected the {role}'s, as `gfm certs` makes it"
            ) from exc
    try:
        credentials.context()
    except ssl.SSLError as exc:
        raise BadInputError(
            f"{credentials.folder}: {exc.reason or exc}; expected a key, its certificate and the "
            "authority's, in PEM"
        ) from exc
    return credentials


def refusal(endpoint: str, credentials: Credentials) -> str:
    """Returns why the two sides of a connection do not believe each other, in OpenSSL's words.

    zenoh says of every failure only that there was one. Empty where another was the cause, such as
    that nobody listens.
    """
    host, port = host_and_port(endpoint)
    try:
        with (
            socket.create_connection((host, port), _PROBE_S) as connection,
            credentials.context().wrap_socket(connection, server_hostname=host) as line,
        ):
            line.recv(1)  # what the other side thinks of our certificate arrives after its own
    except ssl.SSLEOFError:  # one that ends just now
        return ""
    except ssl.SSLCertVerificationError as error:
        return f"its certificate is not believed: {error.verify_message}"
    except ssl.SSLError as error:
        return f"it refuses: {(error.reason or str(error)).replace('_', ' ').lower()}"
    except OSError:
        return ""
    return ""
