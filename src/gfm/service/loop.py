"""The loop of a service process."""

from __future__ import annotations

from collections.abc import Callable

from gfm.core import Clock
from gfm.service.heartbeat import Heartbeat, NoHeartbeat
from gfm.service.service import RunningService, Service
from gfm.service.stand_in import standing_in
from gfm.service.sums import Sums
from gfm.transport import Transport

_SHORTEST_NAP_NS = 100_000
_LONGEST_NAP_NS = 2_000_000


def nap_ns(idle_ns: int) -> int:
    """Returns how long to sleep after `idle_ns` without work.

    Whoever was busy a moment ago is likely to be asked again soon: late by a sixteenth of the time
    since then at most, and by 2 ms in the end.
    """
    return min(max(idle_ns // 16, _SHORTEST_NAP_NS), _LONGEST_NAP_NS)


def run_service(
    service: Service,
    transport: Transport,
    clock: Clock,
    stopped: Callable[[], bool],
    heartbeat: Heartbeat | None = None,
    sums: Sums | None = None,
) -> None:
    """Steps a service until `stopped` says so, then closes it.

    The service is closed before its transport (which the caller owns), because closing may still
    have something to tell: an actor's last sequences, a bridge's hold command.
    """
    heartbeat = heartbeat or NoHeartbeat()
    running = RunningService(service, transport, sums)
    worked_ns = clock.now_ns()
    with standing_in(running, clock, stopped) as stand_in:
        try:
            while not stopped():
                heartbeat.beat()
                stand_in.turn()
                worked = running.step()
                now_ns = clock.now_ns()
                if worked:
                    worked_ns = now_ns
                else:
                    wake_ns, due_ns = now_ns + nap_ns(now_ns - worked_ns), service.due_ns()
                    clock.sleep_until_ns(wake_ns if due_ns is None else min(wake_ns, due_ns))
        finally:
            service.close()
            running.write_sums()
            heartbeat.end()
