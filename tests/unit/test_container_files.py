"""What the containers are told: who is started again, when one is unwell, and what it may use."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gfm.launch.spec import START_ORDER
from gfm.launch.supervision import DEADLINES_S
from gfm.service import read_config
from gfm_actor.config import ActorConfig
from gfm_replay.config import ReplayConfig
from gfm_wire import Role

yaml = pytest.importorskip("yaml")

DOCKER = Path(__file__).resolve().parents[2] / "docker"
COMPOSE = yaml.safe_load((DOCKER / "compose.yaml").read_text())
SERVICES = {
    name: one
    for name, one in COMPOSE["services"].items()
    if "profiles" not in one and name != "certs"
}
OTHERS = {"status": Role.WATCHER, "metrics": Role.WATCHER, "record": Role.DRIVER}


def test_every_role_has_a_container():
    assert sorted(SERVICES) == sorted(START_ORDER)


@pytest.mark.parametrize("role", START_ORDER)
def test_a_service_is_started_again_and_bounded_in_what_it_uses(role):
    service = SERVICES[role]
    assert service["restart"] == "unless-stopped"
    assert service["init"]
    assert service["read_only"]
    assert service["tmpfs"] == ["/tmp:size=64m,mode=1777"]
    assert service["pids_limit"] > 0
    assert {"mem_limit", "cpus"} <= service.keys()


@pytest.mark.parametrize("role", START_ORDER)
def test_a_service_is_unwell_after_the_same_silence_in_compose_image_and_on_a_machine(role):
    assert SERVICES[role]["healthcheck"]["test"] == ["CMD", "healthy", f"{DEADLINES_S[role]:g}"]
    stage = stage_of(SERVICES[role]["build"]["target"])
    assert f'CMD ["healthy", "{DEADLINES_S[role]:g}"]' in stage
    assert '"--heartbeat-file", "/tmp/heartbeat"]' in stage


@pytest.mark.parametrize("role", [role for role in START_ORDER if role != "router"])
def test_what_a_service_counts_outlives_its_process_on_a_volume_of_its_role(role):
    assert f"sums-{role}:/sums" in SERVICES[role]["volumes"]
    assert '"--sums-file", "/sums", "--heartbeat-file"' in stage_of(
        SERVICES[role]["build"]["target"]
    )
    others = [v for v in SERVICES[role]["volumes"] if v.startswith("sums-")]
    assert others == [f"sums-{role}:/sums"]


def stage_of(target: str) -> str:
    """Returns the part of the Dockerfile that ends in an image."""
    text = (DOCKER / "Dockerfile").read_text()
    return text.split(f" AS {target}\n", 1)[1].split("\nFROM ", 1)[0]


def told(service: dict[str, Any]) -> str:
    """Returns the command line that compose gives, or else the image's own."""
    given = service.get("entrypoint") or service.get("command")
    if given is None:
        given = stage_of(service["build"]["target"]).split("\nCMD ")[1]
    return given if isinstance(given, str) else " ".join(given)


@pytest.mark.parametrize("name", [*SERVICES, *OTHERS])
def test_everybody_speaks_by_certificates_and_has_those_of_its_role_alone(name):
    service = COMPOSE["services"][name]
    words = told(service)
    assert "tls/" in words
    assert "--certs" in words
    assert "tcp/" not in words
    mounted = [volume for volume in service["volumes"] if volume.startswith("certs-")]
    role = OTHERS.get(name, name)
    assert mounted == [f"certs-{role}:/certs/{role}:ro"]


def test_certificates_are_made_before_anybody_needs_them_for_every_role_and_the_router_s_host():
    certs = COMPOSE["services"]["certs"]
    made, beside, rests = certs["entrypoint"][-1].split(" && ")
    assert made == "gfm certs --out /certs --host router"
    assert beside.split() == ["touch", certs["healthcheck"]["test"][-1]]
    assert rests == "exec sleep infinity"
    assert certs["network_mode"] == "none"
    assert "networks" not in certs
    folders = ["authority", *Role]
    assert sorted(certs["volumes"]) == sorted(f"certs-{one}:/certs/{one}" for one in folders)
    assert {f"certs-{one}" for one in folders} <= COMPOSE["volumes"].keys()
    condition = {"certs": {"condition": "service_healthy"}}
    assert SERVICES["router"]["depends_on"] == condition
    others = [service for name, service in SERVICES.items() if name != "router"]
    assert all("router" in service["depends_on"] for service in others)


def test_whomever_a_service_depends_on_stays_and_is_started_again():
    """Some engines start nobody again while one of those has ended."""
    needed = {
        name: need["condition"]
        for service in COMPOSE["services"].values()
        for name, need in service.get("depends_on", {}).items()
    }
    assert set(needed.values()) == {"service_healthy"}
    assert {COMPOSE["services"][name]["restart"] for name in needed} == {"unless-stopped"}


def test_the_robot_shares_a_network_with_its_bridge_and_the_router_alone():
    on = {name: set(one["networks"]) for name, one in SERVICES.items()}
    assert {name for name, networks in on.items() if "robot" in networks} == {
        "robot",
        "robot_bridge",
        "router",
    }
    assert on["robot"] == on["robot_bridge"] == {"robot"}
    assert on["router"] == {"robot", "system"}
    assert all(COMPOSE["networks"][name]["internal"] for name in ("robot", "system"))


def test_every_image_has_folders_that_volumes_of_certificates_belong_to_its_user_in():
    runtime = stage_of("runtime").replace("\\\n", " ").split()
    assert {"authority", *Role} <= {word.rstrip(";") for word in runtime}


def test_volumes_that_are_mounted_are_declared():
    mounted = {v for service in SERVICES.values() for v in service.get("volumes", [])}
    named = {volume.split(":")[0] for volume in mounted if not volume.startswith("$")}
    assert named <= COMPOSE["volumes"].keys()
    assert "replay" in named


@pytest.mark.parametrize("folder", sorted((DOCKER / "settings").iterdir()), ids=lambda p: p.name)
def test_replay_keeps_each_environment_s_sequences_apart_on_its_volume(folder):
    config = read_config(ReplayConfig, folder / "replay.toml", {})
    assert config.folder == f"/replay/{folder.name}"
    actor = read_config(ActorConfig, folder / "actor.toml", {})
    assert config.sequence_length == actor.sequence_length
    assert "replay:/replay" in SERVICES["replay"]["volumes"]


@pytest.fixture
def sleeper(tmp_path) -> Iterator[subprocess.Popen[bytes]]:
    """Yields a process that does nothing and does not end by SIGTERM; its heartbeat is `beat`."""
    with subprocess.Popen(
        ["sh", "-c", "trap 'echo told' TERM; echo up; while :; do sleep 0.1; done"],
        stdout=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"up\n"
        (tmp_path / "beat").write_text(f"{process.pid}\n")
        yield process
        process.kill()


def check(beat: Path, age_s: float) -> int:
    """Returns the status of the check of a service that is told after 30 s of silence."""
    if beat.exists():
        os.utime(beat, (time.time() - age_s,) * 2)
    command = [str(DOCKER / "healthy"), "30", str(beat)]
    return subprocess.run(command, check=False, capture_output=True).returncode


def test_a_service_that_beats_is_healthy_and_one_that_starts_is_left_alone(sleeper, tmp_path):
    assert check(tmp_path / "beat", 20.0) == 0
    assert check(tmp_path / "none yet", 0.0) == 1
    assert sleeper.poll() is None


def test_a_service_that_is_silent_is_told_to_stop_and_then_killed(sleeper, tmp_path):
    assert check(tmp_path / "beat", 40.0) == 1
    assert sleeper.stdout.readline() == b"told\n"
    assert sleeper.poll() is None
    assert check(tmp_path / "beat", 50.0) == 1
    assert sleeper.wait(30.0) == -signal.SIGKILL


def test_images_install_what_is_locked_by_the_hashes_of_its_files():
    root = DOCKER.parent
    locked = (root / "requirements.lock").read_text()
    names = [line.partition("==") for line in locked.splitlines() if "==" in line]
    pins = [re.sub(r"[-_.]+", "-", name).lower() + f"=={version}" for name, _, version in names]
    hashed = (root / "requirements.hashes").read_text()
    blocks = [block for block in re.split(r"\n(?=\S)", hashed) if "==" in block]
    assert {block.split()[0] for block in blocks} == set(pins)
    assert all(re.search(r"--hash=sha256:[0-9a-f]{64}", block) for block in blocks)
    stages = (DOCKER / "Dockerfile").read_text()
    installs = [line for line in stages.splitlines() if "pip" in line and " install " in line]
    assert installs
    assert all("--no-deps /wheel/*.whl" in line for line in installs)  # ours, built beside it


def test_the_engine_is_sent_every_file_that_images_copy():
    let_through = {
        line[1:]
        for line in (DOCKER.parent / ".dockerignore").read_text().splitlines()
        if line[:1] == "!"
    }
    copied = [
        name
        for line in (DOCKER / "Dockerfile").read_text().splitlines()
        if line.startswith("COPY ") and "--from" not in line
        for name in line.split()[1:-1]
    ]
    assert "docker/healthy" in copied
    assert [name for name in copied if name.rstrip("/") not in let_through] == []
