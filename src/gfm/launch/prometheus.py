"""What services say of themselves, as Prometheus wants it: base units, and labels for who says."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import final

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from typing_extensions import override

from gfm.core import Status
from gfm.launch.survey import Missing, keeper_statuses, missing_of, statuses
from gfm.transport import Transport

_LABELS = ("role", "name", "host")
_SENDER = "refused_from_"

#: The end of a name here: unit there, and by how much to multiply.
_UNITS = {
    "_per_s": ("per_second", 1.0),
    "_ms": ("seconds", 1e-3),
    "_s": ("seconds", 1.0),
    "_mib": ("bytes", float(2**20)),
    "_bytes": ("bytes", 1.0),
}


@final
class RunCollector(Collector):
    """Asks every service of a run whenever it is asked."""

    def __init__(self, transport: Transport, *, timeout_s: float) -> None:
        """Is ready at once.

        Args:
            transport: A watcher's connection to the run.
            timeout_s: How long to wait for a service that does not answer.
        """
        self._transport = transport
        self._timeout_s = timeout_s

    @override
    def collect(self) -> Iterable[Metric]:
        found = statuses(self._transport, timeout_s=self._timeout_s)
        kept = keeper_statuses(self._transport, timeout_s=self._timeout_s)
        return families(found, missing_of(found, kept) or ())


def families(found: Sequence[Status], missing: Sequence[Missing]) -> list[Metric]:
    """Returns the metrics of those who answered, and who is missing.

    A name is `gfm_`, the counter's or gauge's, and its unit: seconds for `_s` and `_ms`, bytes for
    `_mib`. Whose messages were refused is a label, for senders choose their names.
    """
    up = GaugeMetricFamily(
        "gfm_up", "1: answers; 0: is missing, or not as it should be", labels=("role", "name")
    )
    ailing = {(one.role, one.name) for one in missing}
    for role, name in sorted(ailing | {(one.role, one.name) for one in found}):
        up.add_metric((role, name), 0.0 if (role, name) in ailing else 1.0)
    counters: dict[str, CounterMetricFamily] = {}
    gauges: dict[str, GaugeMetricFamily] = {}
    for status in found:
        who = (status.role, status.name, status.host)
        _add_counters(counters, status.counters, who)
        _add_gauges(gauges, status.gauges, who)
    return [up, *counters.values(), *gauges.values()]


def _add_counters(
    made: dict[str, CounterMetricFamily], counters: Mapping[str, int], who: tuple[str, str, str]
) -> None:
    for counter, count in counters.items():
        is_sender = counter.startswith(_SENDER)
        word = "refused_from" if is_sender else _word(counter)
        labels = (*_LABELS, "sender") if is_sender else _LABELS
        family = made.setdefault(
            word, CounterMetricFamily(f"gfm_{word}", _meaning(word), labels=labels)
        )
        sender = (counter.removeprefix(_SENDER),) if is_sender else ()
        family.add_metric((*who, *sender), float(count))


def _add_gauges(
    made: dict[str, GaugeMetricFamily], gauges: Mapping[str, float], who: tuple[str, str, str]
) -> None:
    for gauge, value in gauges.items():
        word = _word(gauge)
        end = next((end for end in _UNITS if word.endswith(end)), "")
        unit, factor = _UNITS.get(end, ("", 1.0))
        name = f"gfm_{word.removesuffix(end)}"
        family = made.setdefault(
            f"{name}_{unit}", GaugeMetricFamily(name, _meaning(word), labels=_LABELS, unit=unit)
        )
        family.add_metric(who, value * factor)


def _word(name: str) -> str:
    """Returns a name that Prometheus takes."""
    return re.sub(r"[^A-Za-z0-9_]", "_", name)


def _meaning(word: str) -> str:
    return f"{word} of a service's status"
