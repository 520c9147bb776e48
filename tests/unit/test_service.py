"""What every service shares: settings, the loop, its status, signals, exit status."""

from __future__ import annotations

import os
import signal
from typing import final

import pytest
from typing_extensions import override

from gfm.core import (
    BadInputError,
    ConfigError,
    ManualClock,
    RefusedError,
    Status,
    UnreachableError,
)
from gfm.service import (
    RunningService,
    Service,
    ServiceConfig,
    StopSignal,
    exit_status,
    make_parser,
    make_status,
    parse_config,
    read_config,
    run_service,
)
from gfm.service.config import read_toml
from gfm.service.loop import nap_ns
from gfm.service.presence import Presence
from gfm.service.signals import StopRequested
from gfm.transport import MemoryHub, MemoryTransport
from gfm_wire import Ack, StatusRequest


class LearningConfig(ServiceConfig, frozen=True, kw_only=True):
    rate: float = 0.5
    inner: dict[str, int] = {}  # noqa: RUF012  msgspec copies it


@final
class CountingService(Service):
    """Works every other step, and remembers that it was closed."""

    def __init__(self) -> None:
        self.steps = 0
        self.closed = False

    @override
    def step(self) -> bool:
        self.steps += 1
        return self.steps % 2 == 0

    @override
    def status(self) -> Status:
        return make_status("actor", "a", counters={"steps": self.steps, "rejected_messages": 2})

    @override
    def close(self) -> None:
        self.closed = True


def config_of(*argv: str) -> LearningConfig:
    parser = make_parser("gfm-test", "Tests.", listens=True)
    parser.add_argument("--rate", type=float)
    parser.add_argument("--depth", type=int, dest="inner.depth")
    return parse_config(parser, LearningConfig, argv)


def test_flags_win_over_the_file_and_the_file_over_defaults(tmp_path):
    path = tmp_path / "settings.toml"
    path.write_text('rate = 0.25\nrun = "file"\n[inner]\nwidth = 1\n')
    config = config_of("--config", str(path), "--run", "flag", "--depth", "3")
    assert (config.rate, config.run, config.wait_s) == (0.25, "flag", 30.0)
    assert config.inner == {"width": 1, "depth": 3}
    assert config_of("--config", str(path), "--rate", "0.125").rate == 0.125


def test_a_name_is_made_from_host_and_process_where_none_is_given():
    assert config_of().name.startswith("test-")
    assert config_of().name.endswith(f"-{os.getpid()}")
    assert config_of("--name", "me").name == "me"


def test_whoever_listens_connects_to_nobody_unless_told_to():
    assert config_of().connect_endpoints == ("tcp/127.0.0.1:7447",)
    listening = ("--listen", "tcp/127.0.0.1:1", "--insecure")
    assert config_of(*listening).connect_endpoints == ()
    assert config_of(*listening).listen_endpoints == ("tcp/127.0.0.1:1",)
    both = config_of(*listening, "--connect", "tcp/127.0.0.1:2")
    assert both.connect_endpoints == ("tcp/127.0.0.1:2",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rat = 0.5", r"settings.toml: Object contains unknown field `rat`"),
        ('rate = "a"', r"settings.toml: Expected `float`, got `str` - at `\$.rate`"),
        ("[inner]\ndepth = 0.5", r"Expected `int`, got `float` - at `\$.inner\[...\]`"),
        ('name = "a/b"', r"name 'a/b': expected 1 to 64 letters"),
        ('log_level = "loud"', r"Invalid enum value 'loud' - at `\$.log_level`"),
        ("rate =", r"settings.toml: not TOML: "),
    ],
)
def test_a_bad_settings_file_is_refused_with_the_place(tmp_path, text, message):
    path = tmp_path / "settings.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_config(LearningConfig, path, {})


def test_a_file_says_only_what_differs_from_its_base(tmp_path):
    (tmp_path / "base.toml").write_text("rate = 0.1\nlist = [1, 2]\n[inner]\ndepth = 3\nwide = 5\n")
    (tmp_path / "own.toml").write_text('base = "base.toml"\nlist = [3]\n[inner]\ndepth = 4\n')
    told = {"rate": 0.1, "list": [3], "inner": {"depth": 4, "wide": 5}}
    assert read_toml(tmp_path / "own.toml") == told


@pytest.mark.parametrize(
    ("base", "error", "message"),
    [
        (
            "own.toml",
            ConfigError,
            "own.toml: base is 'own.toml', expected the name of another file",
        ),
        ("../a.toml", ConfigError, "own.toml: base is '../a.toml', expected the name of another"),
        ("none.toml", BadInputError, "none.toml: cannot be read"),
        ("next.toml", ConfigError, "next.toml: is the base of own.toml and names one itself"),
    ],
)
def test_a_base_that_is_none_is_refused(tmp_path, base, error, message):
    (tmp_path / "next.toml").write_text('base = "own.toml"')
    (tmp_path / "own.toml").write_text(f'base = "{base}"')
    with pytest.raises(error, match=message):
        read_toml(tmp_path / "own.toml")


def test_a_missing_settings_file_is_bad_input(tmp_path):
    with pytest.raises(BadInputError, match=r"absent.toml: cannot be read: No such file"):
        read_config(LearningConfig, tmp_path / "absent.toml", {})


def test_a_running_service_answers_for_its_status_and_counts_what_its_transport_refused():
    hub = MemoryHub()
    serving, asking = MemoryTransport(hub), MemoryTransport(hub)
    running = RunningService(CountingService(), serving)
    serving.rejected["shape"] = 3
    pending = asking.request("status/actor/a", StatusRequest(), timeout_s=1.0)
    assert running.step()
    status = pending.poll()
    assert isinstance(status, Status)
    assert status.pid == os.getpid()
    assert status.counters == {"steps": 1, "rejected_messages": 5, "rejected_shape": 3}


def test_a_running_service_refuses_other_questions_under_its_status():
    hub = MemoryHub()
    running = RunningService(CountingService(), MemoryTransport(hub))
    pending = MemoryTransport(hub).request("status/actor/a", Ack(), timeout_s=1.0)
    running.step()
    with pytest.raises(RefusedError, match="got Ack, expected StatusRequest"):
        pending.poll()


def test_the_loop_sleeps_only_when_idle_and_closes_the_service_at_the_end():
    service, clock = CountingService(), ManualClock()
    run_service(service, MemoryTransport(MemoryHub()), clock, lambda: service.steps == 10)
    assert service.closed
    assert clock.now_ns() == 5 * 100_000


def test_an_idle_service_naps_a_sixteenth_of_its_idleness_up_to_two_milliseconds():
    naps = {idle_ns: nap_ns(idle_ns) for idle_ns in (0, 1_600_000, 16_000_000, 10**10)}
    assert naps == {0: 100_000, 1_600_000: 100_000, 16_000_000: 1_000_000, 10**10: 2_000_000}


def test_a_service_is_closed_even_if_a_step_fails():
    @final
    class FailingService(Service):
        closed = False

        @override
        def step(self) -> bool:
            raise RefusedError("no")

        @override
        def status(self) -> Status:
            return make_status("actor", "a")

        @override
        def close(self) -> None:
            self.closed = True

    service = FailingService()
    with pytest.raises(RefusedError, match="no"):
        run_service(service, MemoryTransport(MemoryHub()), ManualClock(), lambda: False)
    assert service.closed


@pytest.fixture
def stop_signal():
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    stopped = StopSignal()
    stopped.install()
    yield stopped
    for number, handler in before.items():
        signal.signal(number, handler)


def test_the_first_signal_sets_a_flag(stop_signal):
    assert not stop_signal()
    os.kill(os.getpid(), signal.SIGTERM)
    assert stop_signal()


def test_what_may_end_at_once_ends_with_the_signal(stop_signal):
    with pytest.raises(StopRequested), stop_signal.at_once():
        os.kill(os.getpid(), signal.SIGTERM)
    assert stop_signal()


def test_a_signal_that_came_before_ends_it_before_it_begins(stop_signal):
    os.kill(os.getpid(), signal.SIGTERM)
    with pytest.raises(StopRequested), stop_signal.at_once():
        pytest.fail("began")


def test_a_peer_that_goes_and_comes_back_is_told_in_two_lines(caplog):
    caplog.set_level("INFO")
    clock = ManualClock()
    replay = Presence("replay", clock)
    replay.heard()
    for _ in range(3):
        replay.lost(UnreachableError("replay/insert", 1.0))
        clock.advance_s(2.0)
    replay.heard()
    replay.heard()
    assert caplog.messages == [
        "replay does not answer, asking on: no answer from replay/insert within 1.0 s",
        "replay answers again, after 6.0 s",
    ]


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (ConfigError("rate is 2"), 2, "error: rate is 2\n"),
        (UnreachableError("the hub", 3.0), 1, "error: no answer from the hub within 3.0 s\n"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_an_error_raised_on_purpose_becomes_one_line_and_a_status(capsys, error, status, line):
    def run() -> None:
        raise error

    assert exit_status(run) == status
    assert capsys.readouterr().err == line


def test_success_has_exit_status_zero():
    assert exit_status(lambda: None) == 0
