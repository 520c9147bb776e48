"""What a system is made of, and what it says of itself in sum."""

from __future__ import annotations

import json

import pytest

from gfm.core import ConfigError, Status
from gfm.launch import (
    ProcessSpec,
    SystemSpec,
    actor_processes,
    learner_process,
    replay_process,
    robot_processes,
    router_process,
    summary,
)
from gfm.launch.spec import START_ORDER, STOP_ORDER, in_order, settings_of


def make_system(*processes: ProcessSpec) -> SystemSpec:
    return SystemSpec(run="r", endpoint="tls/127.0.0.1:1", processes=processes, certs="certs")


WHOLE = make_system(
    *actor_processes(2, 5, ("--env", "gfm_fit")),
    *robot_processes(),
    learner_process(),
    replay_process(),
    router_process(),
)


def test_whoever_is_asked_starts_first_and_the_hub_stops_last():
    started = [process.name for process in in_order(WHOLE.processes, START_ORDER)]
    stopped = [process.name for process in in_order(WHOLE.processes, STOP_ORDER)]
    assert started == ["router", "replay", "learner", "robot", "robot-bridge", "actor-0", "actor-1"]
    assert stopped == ["actor-0", "actor-1", "learner", "robot-bridge", "robot", "replay", "router"]


def test_the_hub_listens_and_everybody_else_connects_to_it():
    arguments = {process.name: WHOLE.arguments(process) for process in WHOLE.processes}
    at = ("tls/127.0.0.1:1", "--certs", "certs")
    joining = ("--run", "r", "--connect", *at, "--name", "actor-1")
    assert arguments["router"] == ("--run", "r", "--listen", *at, "--name", "router")
    assert arguments["actor-1"] == (*joining, "--env", "gfm_fit", "--seed", "6")


@pytest.mark.parametrize(
    ("processes", "message"),
    [
        ([learner_process()], "hubs none: expected exactly one"),
        ([router_process(), router_process()], "router, router: expected different names"),
    ],
)
def test_an_impossible_system_is_refused(processes, message):
    with pytest.raises(ConfigError, match=message):
        make_system(*processes)


def test_an_unknown_role_is_refused():
    with pytest.raises(ConfigError, match="role 'cook': expected one of router, replay"):
        ProcessSpec(role="cook", name="a", module="m")


@pytest.mark.parametrize(("name", "engine"), [("sim", "mujoco"), ("drake", "drake")])
def test_a_robot_is_told_its_engine_and_the_bridge_is_not(name, engine):
    robot, bridge = robot_processes(("--clock", "wall"), ("--seed", "1"), name)
    assert robot.arguments == ("--seed", "1", "--engine", engine)
    assert bridge.arguments == ("--robot", "sim", "--clock", "wall")


def test_only_services_with_a_settings_file_are_told_to_read_one(tmp_path):
    (tmp_path / "replay.toml").touch()
    assert settings_of(tmp_path, "replay") == ("--config", str(tmp_path / "replay.toml"))
    assert settings_of(tmp_path, "actor") == ()
    assert settings_of(None, "replay") == ()


def make_service_status(role: str, name: str, **counters: int) -> Status:
    return Status(role=role, name=name, pid=7, host="h", counters=counters)


def test_the_summary_adds_up_what_the_services_say_and_is_plain_json():
    found = [
        make_service_status("actor", "a", env_steps=10, rejected_messages=1),
        make_service_status("actor", "b", env_steps=20),
        Status(
            role="learner",
            name="l",
            pid=7,
            host="h",
            counters={"learner_steps": 6},
            gauges={"weights_version": 5.0},
        ),
        Status(
            role="replay",
            name="r",
            pid=8,
            host="h",
            counters={"replay_sequences": 6, "rejected_messages": 2},
            gauges={"ratio": float("nan")},
        ),
    ]
    sums = json.loads(json.dumps(summary(found), allow_nan=False))
    services = sums.pop("services")
    assert sums == {
        "actors": 2,
        "env_steps": 30,
        "replay_sequences": 6,
        "learner_steps": 6,
        "weights_version": 5,
        "rejected_messages": 3,
        "missing": None,
        "processes": [
            {"role": "actor", "pid": 7, "name": "a", "host": "h"},
            {"role": "actor", "pid": 7, "name": "b", "host": "h"},
            {"role": "learner", "pid": 7, "name": "l", "host": "h"},
            {"role": "replay", "pid": 8, "name": "r", "host": "h"},
        ],
    }
    assert services[3]["gauges"] == {"ratio": None}
    assert services[0]["counters"]["env_steps"] == 10


def test_a_system_of_nothing_sums_to_nothing():
    assert summary([])["actors"] == summary([])["weights_version"] == 0
