"""Writes the manifests for Kubernetes from what compose uses: `python docker/make_kubernetes.py`.

Images, commands, bounds, health checks and settings are those of `compose.yaml` and of
`settings/point_mass`; docker/kubernetes.yaml is what comes of them. See docs/containers.md.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

HERE = Path(__file__).resolve().parent
ROLES = ("router", "replay", "learner", "actor", "robot", "robot_bridge")
#: Volumes that outlive their pod, and how large they are.
KEPT = {
    "replay": "4Gi",
    "checkpoints": "2Gi",
    "recordings": "8Gi",
    "sealed": "64Mi",
}
ACTORS = 4
PORT = 7447
HEAD = """\
# Written by `python docker/make_kubernetes.py` from compose.yaml and settings/point_mass.
#
#   gfm certs --out certs --host router
#   for role in router replay learner actor robot robot_bridge; do
#     kubectl create secret generic gfm-certs-${role/_/-} --from-file=certs/$role
#   done
#   kubectl apply --filename docker/kubernetes.yaml
"""


def manifests(compose: Mapping[str, Any], settings: Path) -> list[dict[str, Any]]:
    """Returns the objects.

    Args:
        compose: The compose file.
        settings: Folder with the services' TOML files.
    """
    data = {path.name: path.read_text(encoding="utf-8") for path in sorted(settings.glob("*.toml"))}
    made = [named("ConfigMap", "v1", "settings") | {"data": data}, router_service()]
    made += [network_policy("router", port=PORT)]
    made += [network_policy(role) for role in ROLES if role != "router"]
    return made + [workload(role, compose["services"][role]) for role in ROLES]


def named(kind: str, api: str, name: str) -> dict[str, Any]:
    """Returns the beginning of an object."""
    labels = {"app.kubernetes.io/name": "gfm"}
    return {
        "apiVersion": api,
        "kind": kind,
        "metadata": {"name": f"gfm-{dashed(name)}", "labels": labels},
    }


def dashed(name: str) -> str:
    """Returns a name as Kubernetes takes it."""
    return name.replace("_", "-")


def selector(role: str) -> dict[str, str]:
    """Returns the labels of a role's pods."""
    return {"app.kubernetes.io/name": "gfm", "app.kubernetes.io/component": dashed(role)}


def router_service() -> dict[str, Any]:
    """Returns the name under which all others, and the router's certificate, know it."""
    service = named("Service", "v1", "router")
    service["metadata"]["name"] = "router"
    port = {"name": "zenoh", "port": PORT, "targetPort": PORT}
    return service | {"spec": {"selector": selector("router"), "ports": [port]}}


def network_policy(role: str, port: int | None = None) -> dict[str, Any]:
    """Returns who may reach a role, by default nobody; all but the router reach it and names."""
    ours = {"podSelector": {"matchLabels": {"app.kubernetes.io/name": "gfm"}}}
    ingress = [] if port is None else [{"from": [ours], "ports": [{"port": port}]}]
    names = {"ports": [{"port": 53, "protocol": one} for one in ("UDP", "TCP")]}
    router = {"to": [{"podSelector": {"matchLabels": selector("router")}}]}
    egress = [] if role == "router" else [router | {"ports": [{"port": PORT}]}, names]
    spec = {
        "podSelector": {"matchLabels": selector(role)},
        "policyTypes": ["Ingress", "Egress"],
        "ingress": ingress,
        "egress": egress,
    }
    return named("NetworkPolicy", "networking.k8s.io/v1", role) | {"spec": spec}


def workload(role: str, service: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the pods of a role: a StatefulSet where something of them is kept."""
    kept = [name for name in mounts(service) if name in KEPT and owns(role, name)]
    template = {"metadata": {"labels": selector(role)}, "spec": pod(role, service)}
    spec: dict[str, Any] = {
        "replicas": ACTORS if role == "actor" else 1,
        "selector": {"matchLabels": selector(role)},
        "template": template,
    }
    if not kept:
        return named("Deployment", "apps/v1", role) | {"spec": spec}
    spec["serviceName"] = f"gfm-{dashed(role)}"
    spec["volumeClaimTemplates"] = [claim(name) for name in kept]
    return named("StatefulSet", "apps/v1", role) | {"spec": spec}


def owns(role: str, volume: str) -> bool:
    """Returns whether a volume is a role's own: claims are of one pod, and others read none."""
    return {"checkpoints": "learner", "recordings": "robot_bridge", "sealed": "robot"}.get(
        volume, volume
    ) == role


def claim(name: str) -> dict[str, Any]:
    """Returns what is asked of the cluster for a volume that is kept."""
    spec = {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": KEPT[name]}}}
    return {"metadata": {"name": name}, "spec": spec}


def mounts(service: Mapping[str, Any]) -> dict[str, tuple[str, bool]]:
    """Returns where a service sees what, and whether it only reads, by the volume's name."""
    found = {}
    for volume in service["volumes"]:
        source, target, *mode = re.sub(r"\$\{[A-Z_]+-([^}]*)\}", r"\1", volume).split(":")
        found[Path(source).name if source[0] in "./" else source] = (target, mode == ["ro"])
    return found


def pod(role: str, service: Mapping[str, Any]) -> dict[str, Any]:
    """Returns what a pod of a role is."""
    volumes, seen = [], []
    for name, (target, reads) in mounts(service).items():
        if name.startswith("certs-"):
            volumes.append(
                {
                    "name": "certs",
                    "secret": {"secretName": f"gfm-{dashed(name)}", "defaultMode": 0o440},
                }
            )
            seen.append({"name": "certs", "mountPath": target, "readOnly": True})
        elif name.startswith("sums-"):  # outlives the container, if not the pod
            volumes.append({"name": "sums", "emptyDir": {"sizeLimit": "16Mi"}})
            seen.append({"name": "sums", "mountPath": target})
        elif name == "point_mass":
            volumes.append({"name": "settings", "configMap": {"name": "gfm-settings"}})
            seen.append({"name": "settings", "mountPath": target, "readOnly": reads})
        elif name in KEPT and owns(role, name):
            seen.append({"name": name, "mountPath": target})
    volumes.append({"name": "tmp", "emptyDir": {"medium": "Memory", "sizeLimit": "64Mi"}})
    seen.append({"name": "tmp", "mountPath": "/tmp"})
    return {
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "securityContext": {
            **dict.fromkeys(("runAsUser", "runAsGroup", "fsGroup"), 10001),
            "runAsNonRoot": True,
            "seccompProfile": {"type": "RuntimeDefault"},
        },
        "containers": [container(role, service, seen)],
        "volumes": volumes,
    }


def container(role: str, service: Mapping[str, Any], seen: list[dict[str, Any]]) -> dict[str, Any]:
    """Returns the one container of a pod of a role."""
    memory = default(service["mem_limit"])
    cpus = float(default(str(service["cpus"])))
    bounds = {"memory": f"{memory[:-1]}{memory[-1].upper()}i", "cpu": f"{cpus:g}"}
    health = service["healthcheck"]
    made = {
        "name": dashed(role),
        "image": service["image"],
        "resources": {"limits": bounds, "requests": {"memory": bounds["memory"], "cpu": "100m"}},
        "securityContext": {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        },
        "livenessProbe": {
            "exec": {"command": health["test"][1:]},
            "initialDelaySeconds": seconds(health["start_period"]),
            "periodSeconds": seconds(health["interval"]),
            "timeoutSeconds": seconds(health["timeout"]),
            "failureThreshold": health["retries"],
        },
        "volumeMounts": seen,
    }
    if "command" in service:
        made["args"] = default(service["command"]).split()
    if role == "router":
        made["ports"] = [{"name": "zenoh", "containerPort": PORT}]
    return made


def default(text: str) -> str:
    """Returns a value of compose with the defaults of what it reads from the environment."""
    return re.sub(r"\$\{[A-Z_]+:?-([^}]*)\}", r"\1", text)


def seconds(text: str) -> int:
    """Returns a duration of compose."""
    return int(text.removesuffix("s"))


class _Blocks(yaml.SafeDumper):
    """Writes texts of several lines as such."""

    def represent_text(self, text: str) -> yaml.ScalarNode:
        """Returns a text as it is written."""
        style = "|" if "\n" in text else None
        return self.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Blocks.add_representer(str, _Blocks.represent_text)


def render() -> str:
    """Returns the file."""
    compose = yaml.safe_load((HERE / "compose.yaml").read_text(encoding="utf-8"))
    made = manifests(compose, HERE / "settings" / "point_mass")
    return HEAD + yaml.dump_all(made, Dumper=_Blocks, sort_keys=False, width=100)


if __name__ == "__main__":
    (HERE / "kubernetes.yaml").write_text(render(), encoding="utf-8")
