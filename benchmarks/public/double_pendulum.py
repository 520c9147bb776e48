"""The DFKI double pendulum in three designs: torque commands on two AK80-6 drives, 500 Hz.

In the sets of open-loop runs the drives get what was commanded. In `double_pendulum_c0_compensated`
the robot balances with its builders' friction compensation, and the command is what the controller
asked for before it: if the compensation is right, no friction is left to be found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

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
_RECORDS = "data/experiment_records/"
_MODELS = Path(__file__).parents[2] / "models"


def model(_read: Reader, *, design: str) -> str:
    """Returns the robot with its builders' masses and inertias, without friction."""
    return (_MODELS / f"double_pendulum_{design}.xml").read_text()


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


#: Runs of a design, each with the hash of its table.
_A0 = {
    "00": "3ea9f330443c902711faaf7f99059dd43e42ea30bb4e2d310d78aa1ec897532d",
    "01": "fbac28e9765eb86380a3ecbc75d7fd71ee7283a4b6eda740f486b5d8d670bab3",
    "02": "1dd18e2ef41511253b9d2ca2a51fd1a9cafe5eae7cb8280496f050cdae02db0d",
    "03": "f686c90294ee11e371b949369f7bd80541c74fe358a4e5c28c52dd86e08ac398",
    "04": "b9800f9fba977af0896617a0d535a67e33b20f54361ef3a025659c928dc50658",
    "05": "e0352a2b381189beaab535df7da8a08a6a96dee72c0b5af3a43449734402f133",
    "11": "b2a69f0087aa45cd9372247316eff12c573b9f7110d96ad80fe923e2badbff3b",
    "12": "a5f61491c72ff648bc527f5c50f4d10b79a2f7b3b561f0fdcf4078d98581c0fd",
    "13": "576bd0a89edf58750bb3b2e1ac880551550761b00407cd70e4e300c4db1fcec4",
}
_C0 = {
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
_C1 = {
    "143339": "94f17287b53187dfe8f4ce131f4e7c49918309fcc915cbae2f64ed3101e7c23b",
    "143524": "03fc5e18915e80afabb3e2674b627f9d849d43675aeacbf586ccd24b3ebd7ca5",
    "143601": "e028c1d7a6a45cfe1b96b7cb33aae412b8888f022677d392f6f9cd4d4f63886d",
    "143704": "e19682394cb7dc8847db9010e568b139a85a447bfbc4547b8828ad58da64a2a9",
    "143747": "8b3f8f25dceec77dbe05c2e687d86485b272fbcabd3af5485a119c9944243a1e",
    "143906": "45c7ed0eb4811ee0b11650b6ae344222bfcf4f7a313c7da611442149ee91e70c",
    "144003": "6841154d567f064208961b2829907fc8457dfd857472286627a0e84da8ab36ed",
    "144115": "c7ec2483e9dd10bfd536e5797002f39af56933ff697da1082aaf28012cda14ed",
    "154220": "c14a6334d98e6c86883cc3a84d41f41d25aab7d5d7a30e4690c0024a20e8972a",
    "154548": "0af9a5f9ef4442a0bd5004cebdaf0eec12c10c01e14d58b722ff7c88b4ce450d",
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


def _runs(
    read: Reader, *, tables: Mapping[str, str], compensated: bool = False
) -> Sequence[Trajectory]:
    """Returns the runs whose names have the paths of their tables in `tables`."""
    return [recording(name, read(path), compensated=compensated) for name, path in tables.items()]


_VISCOUS = frozenset(("viscous_friction", joint) for joint in JOINTS)
_DRY = frozenset(("coulomb_friction", joint) for joint in JOINTS)


def _set(
    design: str, path: str, runs: Mapping[str, str], *, held_out: tuple[str, ...], at_speed: str
) -> PublicSet:
    """Returns the open-loop runs of a design; `path` has RUN where a run's name stands."""
    tables = {f"run{run}": _RECORDS + path.replace("RUN", run) for run in runs}
    return PublicSet(
        name=f"double_pendulum_{design}",
        robot=f"two-joint arm, design {design[0].upper()}.{design[1]}, torque commands",
        repository=_REPOSITORY,
        files=dict(zip(tables.values(), runs.values(), strict=True)),
        recordings=partial(_runs, tables=tables),
        model=partial(model, design=design),
        held_out=held_out,
        known=_DRY,
        allowed=_VISCOUS,
        note=f"known: the builders' cf atan(100 v), {at_speed} N m at speed",
    )


_OPEN_LOOP_C0 = _set(
    "c0",
    "design_C.0/20220914/sys_id/trajectory_RUN.csv",
    _C0,
    held_out=("run06", "run13"),
    at_speed="0.146 and 0.122",
)
_BALANCES = {n: f"{_RECORDS}design_C.0/20220914/{n}/trajectory.csv" for n in _BALANCING}
SETS = (
    _set(
        "a0",
        "design_A.0/20220815/sys_id/trajectory_RUN.csv",
        _A0,
        held_out=("run03", "run11"),
        at_speed="0.146 and 0.292",
    ),
    _OPEN_LOOP_C0,
    replace(
        _OPEN_LOOP_C0,
        name="double_pendulum_c0_compensated",
        robot="design C.0 with friction compensation",
        files=dict(zip(_BALANCES.values(), _BALANCING.values(), strict=True)),
        recordings=partial(_runs, tables=_BALANCES, compensated=True),
        held_out=("184506_acrobot_tvlqr_video",),
        known=frozenset(),
        note="the same friction is compensated for: its name would be false",
    ),
    _set(
        "c1",
        "design_C.1/sys_id/20230629/20230629-RUN/trajectory.csv",
        _C1,
        held_out=("run143704", "run154548"),
        at_speed="0.251 and 0.188",
    ),
)
