"""The table of who may speak, what is made of it, and where anybody may."""

from __future__ import annotations

import itertools
import re

import pytest

from gfm.cli import main
from gfm.core import ConfigError
from gfm.launch import SystemSpec, replay_process, router_process
from gfm.launch.spec import START_ORDER
from gfm.service import make_parser, parse_config
from gfm.transport.access import access_control
from gfm.transport.endpoints import check_endpoints, is_loopback
from gfm_actor.config import ActorConfig
from gfm_learner.config import LearnerConfig
from gfm_replay.config import ReplayConfig
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_wire import CHANNELS, Role, permissions

BY_KEY = {channel.key: channel for channel in CHANNELS}


@pytest.mark.parametrize(
    ("key", "speakers", "listeners"),
    [
        ("weights", {Role.LEARNER}, {Role.ACTOR}),
        ("weights/current", {Role.ACTOR}, {Role.LEARNER}),
        ("replay/insert", {Role.ACTOR}, {Role.REPLAY}),
        ("robot/command", {Role.DRIVER}, {Role.ROBOT_BRIDGE}),
        ("robot/power", {Role.DRIVER}, {Role.ROBOT_BRIDGE}),
        ("sawyer/exchange", {Role.ROBOT_BRIDGE}, {Role.ROBOT}),
    ],
)
def test_what_can_do_harm_is_said_by_one_role_to_one(key, speakers, listeners):
    assert set(BY_KEY[key].speakers) == speakers
    assert set(BY_KEY[key].listeners) == listeners


def test_a_watcher_only_asks_how_all_are_sees_the_robot_and_may_stop_it():
    may = permissions(Role.WATCHER)
    assert (may.publishes, may.answers) == ((), ())
    assert may.hears == ("robot/observation",)
    assert set(may.asks) == {"status/*/*", "supervisor/*", "robot/stop"}


def test_a_key_stands_in_the_table_once():
    assert len(BY_KEY) == len(CHANNELS)
    assert set(START_ORDER) == set(BY_KEY["status/ROLE/NAME"].listeners)


@pytest.mark.parametrize(
    ("config", "role"),
    [
        (ActorConfig, Role.ACTOR),
        (LearnerConfig, Role.LEARNER),
        (ReplayConfig, Role.REPLAY),
        (BridgeConfig, Role.ROBOT_BRIDGE),
        (SimulatedConfig, Role.ROBOT),
    ],
)
def test_every_service_shows_the_certificate_of_its_role(config, role):
    assert config.role is role


def test_the_router_denies_what_no_rule_allows_and_has_rules_for_clients_alone():
    section = access_control()
    assert section["default_permission"] == "deny"
    assert all(rule["permission"] == "allow" for rule in section["rules"])
    roles = {role for subject in section["subjects"] for role in subject["cert_common_names"]}
    assert roles == set(Role) - {Role.ROUTER}


def test_no_rule_allows_more_than_one_thing_in_one_direction():
    # A rule is the product of its messages and keys: what is said and what is heard stay apart.
    ids = [rule["id"] for rule in access_control()["rules"]]
    assert len(set(ids)) == len(ids)
    for rule in access_control()["rules"]:
        assert len(rule["flows"]) == 1
        assert not {"put", "query"} <= set(rule["messages"])
        assert all(key.startswith("gfm/*/") for key in rule["key_exprs"])


def test_nobody_may_delete_or_use_liveliness():
    messages = itertools.chain.from_iterable(r["messages"] for r in access_control()["rules"])
    assert set(messages) == {
        "put",
        "declare_subscriber",
        "query",
        "declare_queryable",
        "reply",
    }


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("localhost", True),
        ("::1", True),
        ("0.0.0.0", False),
        ("::", False),
        ("10.0.0.1", False),
        ("localhost.example", False),
    ],
)
def test_loopback_is_told_from_everything_else(host, expected):
    assert is_loopback(host) is expected


@pytest.mark.parametrize(
    ("listen", "connect", "told", "message"),
    [
        ((), (), {}, "no endpoint"),
        (("tcp/0.0.0.0:1",), (), {}, "without certificates lets anybody who reaches it read"),
        (("tcp/127.0.0.1:1",), (), {}, "without certificates lets anybody who reaches it read"),
        (("tls/0.0.0.0:1",), (), {}, "without certificates: expected tcp/HOST:PORT"),
        (("tcp/127.0.0.1:1",), (), {"secure": True}, "with certificates: expected tls/HOST:PORT"),
        ((), ("tls/hub",), {"secure": True}, "with certificates: expected tls/HOST:PORT"),
        ((), ("tls/[::1]:1",), {"secure": True}, "expected a host's name or an IPv4 address"),
        (
            ("tls/hub:1",),
            (),
            {"secure": True, "insecure": True},
            "insecure, and certificates: expected one of them",
        ),
        (("tls/hub:1",), ("tls/hub:2",), {"secure": True}, "a router connects to nobody"),
    ],
)
def test_endpoints_that_let_anybody_in_or_cannot_be_are_refused(listen, connect, told, message):
    with pytest.raises(ConfigError, match=message):
        check_endpoints(listen, connect, **({"secure": False} | told))


def test_endpoints_that_are_meant_are_accepted():
    check_endpoints(("tcp/127.0.0.1:1",), (), secure=False, insecure=True)
    check_endpoints(("tcp/0.0.0.0:1",), (), secure=False, insecure=True)
    check_endpoints(("tls/0.0.0.0:1",), (), secure=True)
    check_endpoints((), ("tcp/10.0.0.1:1",), secure=False)


@pytest.mark.parametrize("command", ["up", "router"])
def test_a_router_for_everybody_is_refused_in_one_line(command, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("gfm.launch.commands.StopSignal.install", lambda _self: None)
    assert main([command, "--listen", "tcp/0.0.0.0:7447"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert re.match(r"error: endpoint 'tcp/0\.0\.0\.0:7447' with certificates: expected", lines[0])
    assert list(tmp_path.iterdir()) == []


def test_up_refuses_certificates_that_are_not_there_before_it_starts_anything(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("gfm.launch.commands.StopSignal.install", lambda _self: None)
    assert main(["up", "--certs", "nowhere"]) == 2
    assert capsys.readouterr().err.startswith("error: nowhere/router/key.pem: No such file")
    assert list(tmp_path.iterdir()) == []


def test_all_of_a_system_are_told_where_their_certificates_are():
    processes = (router_process(), replay_process())
    system = SystemSpec(run="r", endpoint="tls/hub:1", processes=processes, certs="here")
    for process, flag in zip(processes, ("--listen", "--connect"), strict=True):
        assert system.arguments(process)[:6] == ("--run", "r", flag, "tls/hub:1", "--certs", "here")
    open_to_all = SystemSpec(run="r", endpoint="tcp/0.0.0.0:1", processes=processes, insecure=True)
    told = ["--insecure" in open_to_all.arguments(process) for process in processes]
    assert told == [True, False]


def test_certificates_move_the_default_endpoint():
    def endpoints(*argv: str) -> tuple[str, ...]:
        return parse_config(make_parser("gfm-test", ""), ReplayConfig, argv).connect_endpoints

    assert endpoints() == ("tcp/127.0.0.1:7447",)
    assert endpoints("--certs", "here") == ("tls/127.0.0.1:7447",)
