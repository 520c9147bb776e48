"""`gfm metrics`: a run's numbers as Prometheus reads them."""

from __future__ import annotations

import math
import socket
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread

import pytest
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.parser import text_string_to_metric_families

from gfm.cli import main
from gfm.core import ConfigError, Status
from gfm.launch import metrics_command
from gfm.launch.place import place_to_serve
from gfm.launch.prometheus import RunCollector, families
from gfm.launch.survey import Missing
from gfm.transport import MemoryHub, MemoryTransport, Transport
from gfm_wire import StatusRequest

ACTOR = Status(
    role="actor",
    name="a-0",
    pid=1,
    host="h",
    counters={"env_steps": 70},
    gauges={"weights_age_s": 1.5, "memory_mib": 2.0, "learner_steps_per_s": 4.0, "open_files": 9.0},
)
BRIDGE = Status(
    role="robot_bridge",
    name="b",
    pid=1,
    host="h",
    counters={'refused_from_x.y-"z': 3, "refused_from_u": 1, "rejected_messages": 4},
    gauges={"jitter_p99_ms": 250.0, "silent_s": float("nan")},
)

LABELS = ("role", "name", "host", "sender")


def samples(*found: Status, missing: tuple[Missing, ...] = ()) -> dict[tuple[str, ...], float]:
    """Returns values by name and labels, read back from the text that is served."""

    class Given:
        def collect(self):
            return families(found, missing)

    registry = CollectorRegistry()
    registry.register(Given())
    return read(generate_latest(registry).decode())


def read(text: str) -> dict[tuple[str, ...], float]:
    return {
        (sample.name, *(sample.labels[one] for one in LABELS if one in sample.labels)): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_counters_are_totals_with_who_says_it():
    assert samples(ACTOR)["gfm_env_steps_total", "actor", "a-0", "h"] == 70.0


@pytest.mark.parametrize(
    ("name", "status", "value"),
    [
        ("gfm_weights_age_seconds", ACTOR, 1.5),
        ("gfm_jitter_p99_seconds", BRIDGE, 0.25),
        ("gfm_memory_bytes", ACTOR, 2.0 * 2**20),
        ("gfm_learner_steps_per_second", ACTOR, 4.0),
        ("gfm_open_files", ACTOR, 9.0),
    ],
)
def test_gauges_are_in_base_units_and_their_names_say_so(name, status, value):
    found = samples(ACTOR, BRIDGE)
    assert found[name, status.role, status.name, "h"] == value


def test_numbers_that_are_none_stay_so():
    assert math.isnan(samples(BRIDGE)["gfm_silent_seconds", "robot_bridge", "b", "h"])


def test_senders_whose_messages_were_refused_are_labels():
    found = samples(BRIDGE)
    who = ("gfm_refused_from_total", "robot_bridge", "b", "h")
    assert found[*who, 'x.y-"z'] == 3.0
    assert found[*who, "u"] == 1.0


def test_one_family_has_what_several_services_say():
    other = Status(role="actor", name="a-1", pid=1, host="h", counters={"env_steps": 5})
    made = {family.name: family for family in families((ACTOR, other), ())}
    assert [sample.value for sample in made["gfm_env_steps"].samples] == [70.0, 5.0]


def test_who_is_missing_is_down_and_who_answers_up():
    absent = Missing(role="learner", name="learner", since_s=1.0, why="ended by signal 9")
    hangs = Missing(role="actor", name="a-0", since_s=1.0, why="silent")
    found = samples(ACTOR, BRIDGE, missing=(absent, hangs))
    assert {key: value for key, value in found.items() if key[0] == "gfm_up"} == {
        ("gfm_up", "learner", "learner"): 0.0,
        ("gfm_up", "actor", "a-0"): 0.0,
        ("gfm_up", "robot_bridge", "b"): 1.0,
    }


@contextmanager
def answering(transport: Transport, status: Status) -> Iterator[None]:
    """Answers for a service meanwhile."""
    server = transport.serve(f"status/{status.role}/{status.name}")
    over = False

    def answer() -> None:
        while not over:
            if (request := server.receive()) is not None:
                assert request.message == StatusRequest()
                request.reply(status)

    thread = Thread(target=answer)
    thread.start()
    try:
        yield
    finally:
        over = True
        thread.join()


def test_it_serves_what_services_say_when_it_is_asked(monkeypatch):
    hub = MemoryHub()
    collector = RunCollector(MemoryTransport(hub), timeout_s=5.0)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    monkeypatch.setattr(metrics_command, "_LOOK_S", 0.0)
    texts: list[str] = []

    def stopped() -> bool:
        """Asks once, as Prometheus does."""
        for path in ("metrics", ""):
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/{path}") as answer:
                texts.append(answer.read().decode())
        return True

    with answering(MemoryTransport(hub), ACTOR):
        metrics_command._serve(collector, lambda: "the page", "127.0.0.1", port, stopped)
    assert texts[1] == "the page"
    assert read(texts[0])["gfm_env_steps_total", "actor", "a-0", "h"] == 70.0
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port))


def test_without_its_package_it_says_what_to_install(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "prometheus_client.core", None)
    monkeypatch.delitem(sys.modules, "gfm.launch.prometheus")
    assert main(["metrics"]) == 2
    assert capsys.readouterr().err.endswith("pip install 'gfm-sim2real[metrics]'\n")


def test_it_serves_this_machine_alone_unless_told():
    assert place_to_serve("--http", "127.0.0.1:0", insecure=False) == ("127.0.0.1", 0)
    assert place_to_serve("--http", "[::1]:9464", insecure=False) == ("::1", 9464)
    assert place_to_serve("--http", "0.0.0.0:9464", insecure=True) == ("0.0.0.0", 9464)
    with pytest.raises(
        ConfigError, match=r"--http 0\.0\.0\.0:9464 lets anybody on the network read"
    ):
        place_to_serve("--http", "0.0.0.0:9464", insecure=False)


@pytest.mark.parametrize("text", ["9464", "http://127.0.0.1:9464", "127.0.0.1:", "127.0.0.1:65536"])
def test_a_place_that_is_none_is_one_line(text, capsys):
    assert main(["metrics", "--http", text]) == 2
    assert capsys.readouterr().err == f"error: --http {text!r}: expected HOST:PORT\n"
