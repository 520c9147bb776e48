"""How a zenoh session is set up: as a router, or as a client of one."""

from __future__ import annotations

import json
import logging
import re
import time
from collections.abc import Sequence

import zenoh

from gfm.core import BadInputError, UnreachableError
from gfm.transport.access import access_control, size_limits
from gfm.transport.credentials import Credentials, refusal
from gfm.transport.patience import LEASE_S, STUCK_S

_log = logging.getLogger(__name__)

_SETTINGS = {
    "scouting/multicast/enabled": False,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": round(STUCK_S * 1e6),
    "transport/link/tx/lease": round(LEASE_S * 1e3),
    "transport/link/rx/max_message_size": 256 * 1024 * 1024,
    # Off: containers that share a hub do not share /dev/shm.
    "transport/shared_memory/enabled": False,
}
_RETRY_S = 0.2


def _config(
    mode: str, listen: Sequence[str], connect: Sequence[str], credentials: Credentials | None
) -> zenoh.Config:
    settings: dict[str, object] = {
        "mode": mode,
        **_SETTINGS,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "transport/link/protocols": ["tcp" if credentials is None else "tls"],
    }
    if credentials is not None:
        settings["transport/link/tls"] = credentials.settings(listening=bool(listen))
        if listen:
            settings["access_control"] = access_control()
    if listen:
        settings["low_pass_filter"] = size_limits()
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def listening_session(
    listen: Sequence[str], connect: Sequence[str], credentials: Credentials | None
) -> zenoh.Session:
    """Returns a router.

    Raises:
        BadInputError: an address to listen on is not free.
    """
    try:
        return zenoh.open(_config("router", listen, connect, credentials))
    except zenoh.ZError as exc:
        raise BadInputError(f"cannot listen on {', '.join(listen)}: {_cause(exc)}") from exc


def _cause(error: Exception) -> str:
    text = str(error)
    found = re.search(r"Address already in use|Permission denied|Cannot assign requested", text)
    return found.group().lower() if found else text.split(" at /")[0]


def connected_session(
    connect: Sequence[str], credentials: Credentials | None, *, timeout_s: float
) -> zenoh.Session:
    """Returns a client of the first router that answers.

    Raises:
        BadInputError: one is there, and the two sides do not believe each other.
        UnreachableError: none answered in time.
    """
    began_s = time.monotonic()
    explained = False
    while True:
        try:
            return zenoh.open(_config("client", (), connect, credentials))
        except zenoh.ZError as exc:
            if credentials is not None:
                _check_belief(connect, credentials)
            if time.monotonic() - began_s >= timeout_s:
                raise UnreachableError(f"a router at {', '.join(connect)}", timeout_s) from exc
        if not explained:
            _log.info("waiting up to %.0f s for a router at %s", timeout_s, ", ".join(connect))
            explained = True
        time.sleep(_RETRY_S)


def _check_belief(connect: Sequence[str], credentials: Credentials) -> None:
    """Raises BadInputError where a router is there, and waiting would not make it a friend."""
    for endpoint in connect:
        if why := refusal(endpoint, credentials):
            raise BadInputError(
                f"router at {endpoint}: {why} (our certificate: {credentials.folder})"
            )
