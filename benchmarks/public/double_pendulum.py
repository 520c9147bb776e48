"""The DFKI double pendulum, design C.0: torque commands on two AK80-6 drives, 500 Hz.

Two sets of one robot. In the first the drives get what was commanded. In the second the robot
balances with its builders' friction compensation, and the command is what the controller asked for
before it: if the compensation is right, no friction is left to be found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gfm.core import CommandKind, Trajectory
from public.source import PublicSet, Reader, Repository
from public.tables import columns, stamps

_REPOSITORY = Repository(
    name="dfki-ric-underactuated-lab/double_pendulum",
    commit="1e8544e67f3da72a51ee52fbbb278e131ce2a43f",
    licence="BSD-3-Clause",
)
JOINTS = ("shoulder", "elbow")
_RECORDS = "data/experiment_records/design_C.0/20220914/"
#: The builders' own figures: identified_parameters/design_C.0/model_h1.0, without its friction.
#: Those of their model_3.0 are no body's: the second link's inertia at its joint is below m r^2.
_L1_M = 0.2
_M1_KG, _R1_M, _I1 = 0.5476215952387185, 0.2, 0.024210710672023246
_M2_KG, _R2_M, _I2 = 0.5978621372377623, 0.275, 0.053450262258304355
_ROTOR, _GEAR = 6.287203962819607e-05, 6.0
_MODEL = """\
<mujoco model="double_pendulum_c0">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="RK4"/>
  <default><joint axis="0 1 0" armature="{armature:.9g}"/><motor ctrlrange="-10 10"/></default>
  <worldbody>
    <body name="upper_link">
      <inertial pos="0 0 -{r1:.9g}" mass="{m1:.9g}" diaginertia="{i1:.9g} {i1:.9g} 0.0005"/>
      <joint name="shoulder"/>
      <body name="lower_link" pos="0 0 -{l1:.9g}">
        <inertial pos="0 0 -{r2:.9g}" mass="{m2:.9g}" diaginertia="{i2:.9g} {i2:.9g} 0.0005"/>
        <joint name="elbow"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="shoulder" joint="shoulder"/>
    <motor name="elbow" joint="elbow"/>
  </actuator>
</mujoco>
"""


def model(_read: Reader) -> str:
    """Returns the robot without friction; its builders' inertias are about the joints."""
    return _MODEL.format(
        armature=_GEAR**2 * _ROTOR,
        l1=_L1_M,
        m1=_M1_KG,
        r1=_R1_M,
        i1=_I1 - _M1_KG * _R1_M**2,
        m2=_M2_KG,
        r2=_R2_M,
        i2=_I2 - _M2_KG * _R2_M**2,
    )


def recording(name: str, text: bytes, *, compensated: bool = False) -> Trajectory:
    """Returns a run.

    Args:
        name: Of the recording.
        text: The table.
        compensated: Leave the drives' friction compensation out of the command.
    """
    table = columns(text)

    def both(what: str) -> np.ndarray:
        return np.column_stack([table[f"{what}1"], table[f"{what}2"]])

    told = both("tau_con") - both("tau_fric") if compensated else both("tau_con")
    stamp_ns = stamps(table["time"])
    return Trajectory(
        name=name,
        joint_names=JOINTS,
        stamp_ns=stamp_ns,
        position=both("pos_meas"),
        velocity=both("vel_meas"),
        effort=both("tau_meas"),
        command_kind=CommandKind.EFFORT,
        command_stamp_ns=stamp_ns,
        command=told,
    )


_SYS_ID = {
    "00": "56a084a814614be4e71a9b1fb954565119159a6a0560a84b7f430039366aa68f",
    "01": "43c348acc4bbfb4b8d43096c1b8e539a9fbf3b212ebf2a9b2f2f5d8f426fb671",
    "02": "c12a77f7ea1b37a63fb7e97af7799f3244e058c3b1f966ba7a1ed2493ba32142",
    "03": "6260a0f8c636db5b6ad0b6581fc687e4df497c6a698616cf608ec0504a8463ba",
    "04": "915b8196403f0dbe9ef902aca9aa433739554f8bd568c5e7db9744bfd526edc9",
    "05": "02fa2a83e5d63ebd63af2bb91daf1bc58c3617a940e77f813e54b9902a092e47",
    "06": "7c0db1e5dd964534a2acef59c1104f73938a4c6ef3cd8dd9cfcb4290e6224b4e",
    "12": "6a2edd8ccfe17e57d27cb60830e9dbfa47b0a67666841f3b3436dd2947e08f39",
    "13": "b6b9fd74619336ddb72c225db591717876eaad304c7b4fcf8a748ee081a0cbc2",
}
_BALANCING = {
    "172144_acrobot_lqr_video": "df1c750b28a49131417b0b31c9c55831a374c8d086f62594415681f1f13c62a5",
    "180839_acrobot_tvlqr_video": (
        "ef6883e7f0b68952b39c8fca9b773ba4ade65b6e0b02e7accf7ddc0a582ab6be"
    ),
    "184506_acrobot_tvlqr_video": (
        "942c3e8e2564c6349eba43379402fb56238f369f38d86b921f94471547b3bbbf"
    ),
}


def _open_loop(read: Reader) -> Sequence[Trajectory]:
    return [recording(f"run{n}", read(f"{_RECORDS}sys_id/trajectory_{n}.csv")) for n in _SYS_ID]


def _compensated(read: Reader) -> Sequence[Trajectory]:
    return [
        recording(name, read(f"{_RECORDS}{name}/trajectory.csv"), compensated=True)
        for name in _BALANCING
    ]


_VISCOUS = frozenset(("viscous_friction", joint) for joint in JOINTS)
_DRY = frozenset(("coulomb_friction", joint) for joint in JOINTS)
_OPEN_LOOP = PublicSet(
    name="double_pendulum_c0",
    robot="two-joint arm, torque commands",
    repository=_REPOSITORY,
    files={f"{_RECORDS}sys_id/trajectory_{n}.csv": sha for n, sha in _SYS_ID.items()},
    recordings=_open_loop,
    model=model,
    held_out=("run06", "run13"),
    known=_DRY,
    allowed=_VISCOUS,
    note="known: the builders' cf atan(100 v), 0.146 and 0.122 N m at speed",
)
SETS = (
    _OPEN_LOOP,
    replace(
        _OPEN_LOOP,
        name="double_pendulum_c0_compensated",
        robot="the same, with friction compensation",
        files={f"{_RECORDS}{n}/trajectory.csv": sha for n, sha in _BALANCING.items()},
        recordings=_compensated,
        held_out=("184506_acrobot_tvlqr_video",),
        known=frozenset(),
        note="the same friction is compensated for: its name would be false",
    ),
)
