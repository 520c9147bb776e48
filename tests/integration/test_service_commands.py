"""The commands as their users meet them: one line and an exit status for what cannot be done."""

from __future__ import annotations

import argparse
import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest

from gfm.core import BadInputError, ConfigError
from gfm.launch import Supervisor, free_endpoint, own_system, replay_process, router_process
from gfm.launch.commands import (
    add_router_parser,
    add_status_parser,
    add_up_parser,
    environment_arguments,
)


def arguments_of(*argv: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    subparsers = parser.add_subparsers(required=True)
    add_up_parser(subparsers)
    add_status_parser(subparsers)
    add_router_parser(subparsers)
    return parser.parse_args(argv)


def run_command(*argv: str) -> int:
    arguments = arguments_of(*argv)
    return arguments.run(arguments)


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Iterator[tuple[str, ...]]:
    """Yields by which flags a running replay service is reached, but for its run, "shop"."""
    folder = tmp_path_factory.mktemp("shop")
    system = own_system("shop", folder, (router_process(), replay_process()))
    with Supervisor(system, folder) as supervisor:
        supervisor.start()
        yield ("--connect", system.endpoint, "--certs", system.certs)


def test_status_prints_the_sums_and_every_process_as_json(place, capsys):
    assert run_command("status", "--json", *place, "--run", "shop") == 0
    printed = json.loads(capsys.readouterr().out)
    assert [process["role"] for process in printed["processes"]] == ["replay", "router"]
    assert printed["replay_sequences"] == printed["actors"] == printed["rejected_messages"] == 0
    assert printed["services"][0]["note"] == "waiting for the first sequence"


def test_status_prints_a_table_for_people(place, capsys):
    assert run_command("status", *place, "--run", "shop") == 0
    printed = capsys.readouterr().out
    assert "replay" in printed
    assert "actors 0" in printed


def test_status_of_a_run_that_nobody_is_in_is_bad_input(place):
    with pytest.raises(BadInputError, match="no service of run 'other' at tls/"):
        run_command("status", *place, "--run", "other")


def test_status_where_no_router_is_is_bad_input(monkeypatch):
    monkeypatch.setattr("gfm.launch.commands._STATUS_TIMEOUT_S", 0.0)
    absent = free_endpoint()
    with pytest.raises(BadInputError, match=f"no system at {absent}: start one with `gfm up`"):
        run_command("status", "--connect", absent)


def test_up_refuses_a_damaged_model_before_it_starts_anything(monkeypatch, tmp_path):
    monkeypatch.setattr("gfm.launch.commands.StopSignal.install", lambda _self: None)
    (tmp_path / "arm.xml").write_text("<mujoco/>")
    (tmp_path / "arm.effects.json").write_text("{")
    model = f"velocity={tmp_path / 'arm.xml'}"
    with pytest.raises(BadInputError, match=r"effects .*arm.effects.json: .* expected JSON"):
        run_command("up", "--dir", str(tmp_path / "up"), "--model", model)
    assert not (tmp_path / "up").exists()


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--actors", "0"], "--actors is 0, expected at least 1"),
        (["--config-dir", "/nowhere"], "--config-dir /nowhere: expected a folder"),
    ],
)
def test_up_refuses_what_cannot_be_before_it_starts_anything(argv, message, monkeypatch, tmp_path):
    monkeypatch.setattr("gfm.launch.commands.StopSignal.install", lambda _self: None)
    with pytest.raises(ConfigError if "actors" in message else BadInputError, match=message):
        run_command("up", "--dir", str(tmp_path / "up"), *argv)
    assert not (tmp_path / "up").exists()


def test_up_refuses_settings_of_its_supervision_before_it_starts_anything(monkeypatch, tmp_path):
    monkeypatch.setattr("gfm.launch.commands.StopSignal.install", lambda _self: None)
    (tmp_path / "supervisor.toml").write_text("most_deaths = 0\n")
    with pytest.raises(ConfigError, match=r"supervisor.toml: Expected `int` >= 1"):
        run_command("up", "--dir", str(tmp_path / "up"), "--config-dir", str(tmp_path))
    assert not (tmp_path / "up").exists()


def test_up_passes_the_environment_on_to_actors_and_learner():
    argv = ["--env", "gfm_fit", "--model", "velocity=v.xml", "--model", "effort=e.xml"]
    argv += ["--recording", "a.mcap", "--recording", "b.mcap", "--horizon", "7"]
    assert list(environment_arguments(arguments_of("up", *argv))) == argv
    assert environment_arguments(arguments_of("up")) == ()


def replay(*argv: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gfm_replay", *argv],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )


def test_a_port_in_use_is_one_line_and_status_two():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        ended = replay("--listen", address, "--insecure", "--log-level", "error")
    assert ended.returncode == 2
    assert ended.stderr == f"error: cannot listen on {address}: address already in use\n"


def test_a_router_that_stays_away_is_one_line_and_status_one():
    address = free_endpoint()
    ended = replay("--connect", address, "--wait-s", "0.1", "--log-level", "error")
    assert ended.returncode == 1
    assert ended.stderr == f"error: no answer from a router at {address} within 0.1 s\n"


def test_an_unknown_setting_is_one_line_and_status_two(tmp_path):
    path = tmp_path / "replay.toml"
    path.write_text("capacity = 3\n")
    ended = replay("--config", str(path))
    assert ended.returncode == 2
    assert ended.stderr == f"error: {path}: Object contains unknown field `capacity`\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_a_service_cleanly(number):
    process = started_replay()
    process.send_signal(number)
    _, rest = process.communicate(timeout=30)
    assert process.returncode == 0
    assert f"{number.name}: stopping" in rest
    assert rest.rstrip().endswith("stopped")


def test_an_actor_that_waits_for_a_learner_stops_at_once(place):
    argv = ("gfm_actor", *place, "--run", "shop", "--wait-s", "300")
    process = started(*argv, until="connected")
    process.send_signal(signal.SIGTERM)
    _, rest = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "SIGTERM: stopping" in rest
    assert rest.rstrip().endswith("stopped")


def started_replay() -> subprocess.Popen[str]:
    return started("gfm_replay", "--listen", free_endpoint(), "--insecure", until="running")


def started(*argv: str, until: str) -> subprocess.Popen[str]:
    return started_python("-m", *argv, until=until)


def started_python(*argv: str, until: str) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, *argv], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    while until not in (line := process.stderr.readline()):
        assert line, "it ended"
    return process


def test_a_second_signal_ends_a_service_that_does_not_stop(tmp_path):
    script = tmp_path / "stubborn.py"
    script.write_text(
        "from gfm.service import StopSignal\n"
        "stopped = StopSignal(); stopped.install(); print('up', flush=True)\n"
        "while not stopped(): pass\n"
        "print('asked', flush=True)\n"
        "while True: pass\n"
    )
    process = subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.terminate()
        assert process.stdout.readline() == "asked\n"
        process.terminate()
        assert process.wait(30) == -signal.SIGTERM


def test_a_bare_router_makes_certificates_by_which_others_in_its_folder_ask_it(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    address = free_endpoint(secure=True)
    script = (
        "import argparse, sys; from gfm.launch.commands import add_router_parser\n"
        "parser = argparse.ArgumentParser(); add_router_parser(parser.add_subparsers())\n"
        "arguments = parser.parse_args(); sys.exit(arguments.run(arguments))\n"
    )
    command = [sys.executable, "-c", script, "router", "--listen", address]
    with subprocess.Popen(command) as process:
        while True:
            try:
                run_command("status", "--json", "--connect", address)
            except BadInputError:
                continue
            break
        process.terminate()
        assert process.wait(30) == 0
    (answered,) = json.loads(capsys.readouterr().out)["services"]
    assert answered["role"] == "router"
    assert answered["gauges"]["connected_watcher"] == 1.0
    assert list(tmp_path.iterdir()) == [tmp_path / "runs"]


LONG_STEP = """
import sys, time
from pathlib import Path
from gfm.service import Service, ServiceConfig, make_status, serve

class Slow(Service):
    def step(self):
        print("begun", file=sys.stderr, flush=True)
        while not Path(sys.argv[2]).exists():
            time.sleep(0.01)
        return True

    def status(self):
        return make_status("learner", "slow", note="learning")

    def close(self):
        pass

serve(ServiceConfig(listen=sys.argv[1], insecure=True, name="slow"), lambda *_: Slow())
"""


def test_a_service_in_a_long_step_answers_and_hears_that_it_shall_stop(tmp_path, capsys):
    address, over = free_endpoint(), tmp_path / "over"

    def note() -> str:
        assert run_command("status", "--json", "--connect", address) == 0
        return json.loads(capsys.readouterr().out)["services"][0]["note"]

    process = started_python("-c", LONG_STEP, address, str(over), until="begun")
    assert note().startswith("learning; in one step for ")
    process.send_signal(signal.SIGTERM)
    assert process.stderr is not None
    assert "SIGTERM: stopping" in process.stderr.readline()
    assert note().endswith("told to stop, after this step")
    assert process.poll() is None
    over.touch()
    assert process.wait(30) == 0
    process.stderr.close()
