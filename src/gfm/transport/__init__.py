"""One port for messages between processes, two adapters: zenoh and in-memory."""

from gfm.transport.asking import ask
from gfm.transport.bodies import QUEUED_REQUESTS
from gfm.transport.credentials import Credentials, read_credentials
from gfm.transport.endpoints import check_endpoints, default_endpoint, is_loopback
from gfm.transport.memory import MemoryHub, MemoryTransport
from gfm.transport.port import PendingReply, Request, Server, Subscription, Transport
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
