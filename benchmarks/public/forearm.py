"""One joint of an arm that turns by torque commands over a serial line, about 30 a second.

The other joints were told no torque and stayed where they were: in the model they are welded. So
few measurements a second are a set of their own: what they cannot tell should not be named.
"""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import mujoco
import numpy as np

from gfm.core import CommandKind, Trajectory
from public.legs_and_arms import halves
from public.source import PublicSet, Reader, Repository
from public.tables import stamps

_CAPTURE = "results/real_uart_capture_collect_joint_3.npz"
_URDF = "am_d02_model/urdf/AM-D02-AemLURDF0413.urdf"
#: The joint that is turned: its name, and its column.
_JOINT, _COLUMN = "ArmLfourth_Joint", 2
_LIMIT_NM = 27.0


def with_one_joint(urdf: bytes, joint: str, limit_nm: float) -> str:
    """Returns a URDF's links as MJCF, all welded but at one joint, which gets a motor.

    Args:
        urdf: The robot; its shapes are left out.
        joint: That stays.
        limit_nm: Of its motor.
    """
    root = ET.fromstring(urdf)
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    for one in root.iter("joint"):
        if one.get("name") != joint:
            one.set("type", "fixed")
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    spec.option.timestep = 0.002
    motor = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_motor()
    motor.ctrllimited = True
    motor.ctrlrange = [-limit_nm, limit_nm]
    spec.compile()
    return str(spec.to_xml())


def recording(name: str, packed: bytes, joint: str, column: int) -> Trajectory:
    """Returns a capture, as one joint sees it."""
    found = np.load(io.BytesIO(packed))

    def of_joint(what: str) -> np.ndarray:
        return np.asarray(found[what], float)[:, column : column + 1]

    stamp_ns = stamps(found["time"])
    return Trajectory(
        name=name,
        joint_names=(joint,),
        stamp_ns=stamp_ns,
        position=of_joint("q"),
        velocity=of_joint("qd"),
        effort=of_joint("tau_measured"),
        command_kind=CommandKind.EFFORT,
        command_stamp_ns=stamp_ns,
        command=of_joint("tau_command"),
    )


def _recordings(read: Reader) -> Sequence[Trajectory]:
    return halves(recording("run", read(_CAPTURE), _JOINT, _COLUMN), at=0.7)


def _model(read: Reader) -> str:
    return with_one_joint(read(_URDF), _JOINT, _LIMIT_NM)


SETS = (
    PublicSet(
        name="forearm",
        robot="AM-D02 arm, one joint, torque commands at 30 Hz",
        repository=Repository(
            name="YIZHIXIAOCANGSHU/Friction-Identification-for-Manipulators",
            commit="f915751262ab6c43dc436b7395f41b03f2e8ee2b",
            licence="none",
        ),
        files={
            _CAPTURE: "9ba9fc335bf778dd42eac83ade5bf67d51ad4600f18861e85115f781d732fee0",
            _URDF: "ef935e15ff7e60bac55d8972f0d96db223a1d402aea97190f25c4c34611e0de5",
        },
        recordings=_recordings,
        model=_model,
        held_out=("run_end",),
        known=frozenset({("coulomb_friction", _JOINT), ("viscous_friction", _JOINT)}),
        note="known: the authors' 0.338 N m and 0.266 N m s/rad (their own R^2: 0.85)",
    ),
)
