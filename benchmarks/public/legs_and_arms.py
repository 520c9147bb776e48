"""An arm and two legs that chirp in the air: position servos with known gains, 200 Hz.

The models of the repository have friction, damping and armature that its authors identified from
these recordings. Here they are taken out, and are what is known.
"""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy._core import multiarray
from torch.serialization import safe_globals

from gfm.core import CommandKind, Trajectory
from public.source import PublicSet, Reader, Repository
from public.tables import stamps

_REPOSITORY = Repository(
    name="RX-00/sim2real-robot-identification",
    commit="1a22bd03a70ed3f542d6979bd8d0e73888391c48",
    licence="BSD-3-Clause",
)
_ARM = tuple(f"joint{n}" for n in range(1, 7))
_LEG = ("FL_hip_joint", "FL_thigh_joint", "FL_calf_joint")
#: What a joint of the repository's models has, and how it is called here.
_IDENTIFIED = {
    "armature": "armature",
    "damping": "viscous_friction",
    "frictionloss": "coulomb_friction",
}
_LEFT_OUT = ("asset", "keyframe", "sensor", "actuator")


def tensors(packed: bytes) -> Mapping[str, Any]:
    """Returns a file's arrays; a file that holds anything but arrays is refused by torch."""
    array = multiarray._reconstruct
    plain = [np.ndarray, np.dtype, *(type(np.dtype(kind)) for kind in ("f4", "f8", "i8"))]
    both = [(array, "numpy.core.multiarray._reconstruct"), array]
    with safe_globals([*both, *plain]):
        return dict(torch.load(io.BytesIO(packed), weights_only=True))


def recording(name: str, packed: bytes, joints: Sequence[str]) -> Trajectory:
    """Returns a run: the first joints of those that the file has."""
    found = tensors(packed)
    position, velocity, told = (
        np.asarray(found[key], float)[:, : len(joints)]
        for key in ("dof_pos", "dof_vel", "des_dof_pos")
    )
    stamp_ns = stamps(np.asarray(found["time"], float))
    return Trajectory(
        name=name,
        joint_names=tuple(joints),
        stamp_ns=stamp_ns,
        position=position,
        velocity=velocity,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=told,
    )


def halves(run: Trajectory, at: float) -> list[Trajectory]:
    """Returns what comes before and after a share of a recording."""
    row = int(at * len(run.stamp_ns))
    return [
        replace(
            run,
            name=f"{run.name}_{name}",
            stamp_ns=run.stamp_ns[part],
            position=run.position[part],
            velocity=None if run.velocity is None else run.velocity[part],
            effort=None if run.effort is None else run.effort[part],
            command_stamp_ns=run.command_stamp_ns[part],
            command=run.command[part],
        )
        for name, part in (("begin", slice(0, row)), ("end", slice(row, None)))
    ]


def bare(xml: str, gains: Mapping[str, tuple[float, float]]) -> str:
    """Returns a model with ideal joints, of the links that some joints move, with servos.

    Shapes and meshes are left out: all links have inertials, and the robot moves in the air.

    Args:
        xml: The repository's model.
        gains: For each joint that stays, N m/rad and N m s/rad.
    """
    root = ET.fromstring(xml)
    limits = {m.get("joint", ""): m.get("ctrlrange") for m in root.iter("motor")}
    for element in [root, *root.iter("body")]:
        for child in [*element]:
            if child.tag in (*_LEFT_OUT, "geom", "site", "freejoint"):
                element.remove(child)
    _without_other_links(root, gains)
    for joint in root.iter("joint"):
        for name in _IDENTIFIED:
            joint.attrib.pop(name, None)
    actuators = ET.SubElement(root, "actuator")
    for joint, (kp, kd) in gains.items():
        limited = {"forcerange": limit} if (limit := limits.get(joint)) else {}
        told = {"name": joint, "joint": joint, "kp": f"{kp:g}", "kv": f"{kd:g}", **limited}
        ET.SubElement(actuators, "position", told)
    return ET.tostring(root, encoding="unicode")


def _without_other_links(root: ET.Element, kept: Mapping[str, Any]) -> None:
    """Takes out bodies that branch off, and welds joints that stay where they are."""
    for body in [*root.iter("body")]:
        for child in body.findall("body"):
            moved = {joint.get("name") for joint in child.iter("joint")}
            if moved and not moved & set(kept) and len(body.findall("body")) > 1:
                body.remove(child)
        for joint in body.findall("joint"):
            if joint.get("name") not in kept:
                body.remove(joint)


def _gains(packed: bytes, joints: Sequence[str]) -> dict[str, tuple[float, float]]:
    found = tensors(packed)
    pairs = zip(np.asarray(found["kp"], float), np.asarray(found["kd"], float), strict=True)
    return {joint: (float(kp), float(kd)) for joint, (kp, kd) in zip(joints, pairs, strict=False)}


def _known(joints: Sequence[str]) -> frozenset[tuple[str, str]]:
    return frozenset((effect, joint) for joint in joints for effect in _IDENTIFIED.values())


def _recordings(read: Reader, *, paths: Sequence[str], joints: Sequence[str]) -> list[Trajectory]:
    runs = [recording(f"run{i}", read(path), joints) for i, path in enumerate(paths)]
    return halves(runs[0], at=0.7) if len(runs) == 1 else runs


def _model(read: Reader, *, xml: str, data: str, joints: Sequence[str]) -> str:
    return bare(read(xml).decode(), _gains(read(data), joints))


_Z1 = {"datasets/z1/traj_0.pt": "a1020afada90eac000aecfa3e8f4e6a57fb2b86a7e3f34e552c1f489ca6d2518"}
_GO2 = {
    f"datasets/go2/traj_{n}.pt": sha
    for n, sha in enumerate(
        (
            "0c9d84e7eb7c07c0f5ff018e177dcb64e3e4bae422d60958a83c2c734f796f5f",
            "60340e837253d52a0d32b0301eb538dffd7cc6ec41dbd4406c512a3e35e0ff4a",
            "17bf1062307ca5d2da206ad2a93417b70e9b76ab5717aa77926801bbb669f2c4",
            "3b505930c28435a9285fde7d08d373b3d22090dcf82c0669f25c4d3843ea3e57",
        )
    )
}
_ALIENGO = {
    "datasets/aliengo/traj_0.pt": "fd58442b024056044d0c52a301251be30417d2a89cc61f98ef8e50783d14c772"
}
_Z1_MODEL = {
    "robot_model/z1/z1.xml": "d869247becae76996c3009f251cd700a1696277117d05d46b00745b7cd67200b"
}
_GO2_MODEL = {
    "robot_model/go2/go2.xml": "385127fe78aba3fdd06a6cece91a4daa56e9193e23e6ab5a8a226bee59990b38"
}

_ALIENGO_MODEL = {
    "robot_model/aliengo/aliengo.xml": (
        "33473f56beb66c9300f587bb108097da78ce039cfbb32a2aec9175b0d10ccef1"
    )
}


def _set(
    name: str,
    robot: str,
    joints: Sequence[str],
    data: Mapping[str, str],
    model: Mapping[str, str],
    held_out: str,
) -> PublicSet:
    paths, (xml,) = sorted(data), model
    return PublicSet(
        name=name,
        robot=robot,
        repository=_REPOSITORY,
        files={**data, **model},
        recordings=partial(_recordings, paths=paths, joints=joints),
        model=partial(_model, xml=xml, data=paths[0], joints=joints),
        held_out=(held_out,),
        known=_known(joints),
        note="known: what the repository's authors fitted: armature, damping, dry friction",
    )


SETS = (
    _set("z1", "Unitree Z1, six joints, position servos", _ARM, _Z1, _Z1_MODEL, "run0_end"),
    _set("go2_front_left", "Unitree Go2, one leg, base held", _LEG, _GO2, _GO2_MODEL, "run3"),
    _set(
        "aliengo_front_left",
        "Unitree Aliengo, one leg, base held",
        _LEG,
        _ALIENGO,
        _ALIENGO_MODEL,
        "run0_end",
    ),
)
