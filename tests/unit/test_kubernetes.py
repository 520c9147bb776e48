"""The manifests for Kubernetes say what compose says."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

from gfm.launch.spec import START_ORDER
from gfm.launch.supervision import DEADLINES_S
from gfm_wire import Role

yaml = pytest.importorskip("yaml")

DOCKER = Path(__file__).resolve().parents[2] / "docker"
COMPOSE = yaml.safe_load((DOCKER / "compose.yaml").read_text())["services"]
OBJECTS = list(yaml.safe_load_all((DOCKER / "kubernetes.yaml").read_text()))
KINDS = ("Deployment", "StatefulSet")
PODS = {
    one["spec"]["template"]["metadata"]["labels"]["app.kubernetes.io/component"]: one["spec"]
    for one in OBJECTS
    if one["kind"] in KINDS
}


def pod_of(role: str) -> dict[str, Any]:
    return PODS[role.replace("_", "-")]["template"]["spec"]


def container_of(role: str) -> dict[str, Any]:
    (container,) = pod_of(role)["containers"]
    return container


def test_the_file_is_what_compose_makes_of_it():
    path = DOCKER / "make_kubernetes.py"
    spec = importlib.util.spec_from_file_location("make_kubernetes", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert (DOCKER / "kubernetes.yaml").read_text() == module.render()


def test_every_role_has_pods():
    assert sorted(PODS) == sorted(role.replace("_", "-") for role in START_ORDER)


@pytest.mark.parametrize("role", START_ORDER)
def test_a_container_is_told_what_compose_tells_it_and_is_unwell_after_the_same_silence(role):
    container = container_of(role)
    assert container["image"] == COMPOSE[role]["image"]
    assert container["livenessProbe"]["exec"]["command"] == ["healthy", f"{DEADLINES_S[role]:g}"]
    words = " ".join(container.get("args", []))
    assert "$" not in words
    if "command" in COMPOSE[role]:
        first = COMPOSE[role]["command"].split("$")[0].split()
        assert container["args"][: len(first)] == first


@pytest.mark.parametrize("role", START_ORDER)
def test_a_container_is_bounded_and_has_no_rights(role):
    container, pod = container_of(role), pod_of(role)
    assert container["resources"]["limits"].keys() == {"memory", "cpu"}
    assert container["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    assert pod["securityContext"]["runAsNonRoot"]
    assert pod["securityContext"]["runAsUser"] == 10001
    assert not pod["automountServiceAccountToken"]
    (tmp,) = [volume for volume in pod["volumes"] if volume["name"] == "tmp"]
    assert tmp["emptyDir"] == {"medium": "Memory", "sizeLimit": "64Mi"}


@pytest.mark.parametrize("role", START_ORDER)
def test_a_pod_sees_the_certificates_of_its_role_alone_where_compose_shows_them(role):
    secrets = [v["secret"]["secretName"] for v in pod_of(role)["volumes"] if "secret" in v]
    assert secrets == [f"gfm-certs-{role.replace('_', '-')}"]
    places = [m["mountPath"] for m in container_of(role)["volumeMounts"] if m["name"] == "certs"]
    assert places == [f"/certs/{Role(role)}"]


@pytest.mark.parametrize("role", START_ORDER)
def test_everything_that_is_mounted_is_a_volume_or_a_claim(role):
    mounted = {mount["name"] for mount in container_of(role)["volumeMounts"]}
    claims = PODS[role.replace("_", "-")].get("volumeClaimTemplates", [])
    there = {one["name"] for one in pod_of(role)["volumes"]}
    assert mounted == there | {one["metadata"]["name"] for one in claims}


@pytest.mark.parametrize(
    ("role", "volume"),
    [
        ("replay", "replay"),
        ("learner", "checkpoints"),
        ("robot_bridge", "recordings"),
        ("robot", "sealed"),
    ],
)
def test_what_outlives_a_process_is_claimed(role, volume):
    (claim,) = PODS[role.replace("_", "-")]["volumeClaimTemplates"]
    assert claim["metadata"]["name"] == volume


def test_only_the_router_can_be_reached_and_under_the_name_of_its_certificate():
    policies = {o["metadata"]["name"]: o["spec"] for o in OBJECTS if o["kind"] == "NetworkPolicy"}
    assert len(policies) == len(START_ORDER)
    reachable = [name for name, spec in policies.items() if spec["ingress"]]
    assert reachable == ["gfm-router"]
    assert policies["gfm-router"]["egress"] == []
    (service,) = [one for one in OBJECTS if one["kind"] == "Service"]
    assert service["metadata"]["name"] == "router"
    assert (
        container_of("router")["ports"][0]["containerPort"] == service["spec"]["ports"][0]["port"]
    )
