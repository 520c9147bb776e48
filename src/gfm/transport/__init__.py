"""One port for messages between processes, two adapters: zenoh and in-memory.

zenoh is loaded with the first use of its adapter: a diagnosis needs none.
"""

from typing import TYPE_CHECKING

from gfm.core.extras import needs
from gfm.transport.asking import ask
from gfm.transport.bodies import QUEUED_REQUESTS
from gfm.transport.credentials import Credentials, read_credentials
from gfm.transport.endpoints import check_endpoints, default_endpoint, is_loopback
from gfm.transport.memory import MemoryHub, MemoryTransport
from gfm.transport.port import PendingReply, Request, Server, Subscription, Transport

if TYPE_CHECKING:
    from gfm.transport.zenoh import ZenohTransport

__all__ = [
    "QUEUED_REQUESTS",
    "Credentials",
    "MemoryHub",
    "MemoryTransport",
    "PendingReply",
    "Request",
    "Server",
    "Subscription",
    "Transport",
    "ZenohTransport",
    "ask",
    "check_endpoints",
    "default_endpoint",
    "is_loopback",
    "read_credentials",
]


def __getattr__(name: str) -> object:
    if name != "ZenohTransport":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with needs("messages between processes need", "zenoh", "wire"):
        from gfm.transport.zenoh import ZenohTransport
    return ZenohTransport
