"""The command `gfm top`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from gfm.core import BadInputError, Clock, ConfigError, MonotonicClock
from gfm.launch.flags import add_endpoint, address_of
from gfm.launch.overview import Onlooker, Row
from gfm.service import StopSignal

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Shows a running system as a table that is always of now: who is there, what each does per second,
waits for and refuses, who is missing and why. Ctrl-C ends it.
"""
_ASK_S = 1.0
_JOIN_S = 3.0
_NAP_NS = 50_000_000


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm top`."""
    parser = subparsers.add_parser(
        "top", help="watch a running system, live", description=_DESCRIPTION
    )
    parser.add_argument(
        "--period-s", type=float, default=1.0, help="between two looks (default: %(default)s)"
    )
    add_endpoint(parser, "--connect", "the system's router")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Shows the table until told to stop."""
    if not arguments.period_s > 0.0:
        raise ConfigError(f"--period-s is {arguments.period_s:g}, expected more than 0")
    if not sys.stdout.isatty():
        raise BadInputError("gfm top needs a terminal; `gfm status --json` is for programs")
    address, clock = address_of(arguments), MonotonicClock()
    with address.watch(name="top", timeout_s=_JOIN_S) as transport:
        stopped = StopSignal()
        stopped.install()
        watch(Onlooker(transport, clock, timeout_s=_ASK_S), arguments.period_s, clock, stopped)
    return 0


def watch(
    onlooker: Onlooker,
    period_s: float,
    clock: Clock,
    stopped: Callable[[], bool],
    console: Console | None = None,
) -> None:
    """Shows the table until `stopped` says so."""
    with Live(console=console, screen=True, auto_refresh=False) as live:
        while not stopped():
            due_ns = clock.now_ns() + round(period_s * 1e9)
            live.update(table(onlooker.look()), refresh=True)
            while not stopped() and clock.now_ns() < due_ns:
                clock.sleep_until_ns(min(clock.now_ns() + _NAP_NS, due_ns))


def table(rows: Sequence[Row]) -> Table:
    """Returns the rows for a terminal; what is missing or refuses messages is red."""
    caption = "" if rows else "nobody answers; another run is named with --run"
    made = Table(expand=True, caption=caption)
    for name in ("role", "name"):
        made.add_column(name, no_wrap=True)
    for name in ("done", "per s", "refused", "MiB", "files"):
        made.add_column(name, justify="right", no_wrap=True)
    made.add_column("state", ratio=2)
    made.add_column("note", ratio=2)
    for row in rows:
        refused = f"[red]{row.refused:,}[/red]" if row.refused else "0"
        made.add_row(
            *(escape(row.role), escape(row.name)),
            "" if row.done is None else f"{row.done:,} {row.unit}",
            "" if row.per_s is None else f"{row.per_s:,.1f}",
            refused if row.host else "",
            *(_number(row.memory_mib), _number(row.open_files)),
            *(escape(row.state), escape(row.note)),
            style="" if row.is_well else "bold red",
        )
    return made


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:,.0f}"
