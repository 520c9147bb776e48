"""The DFKI torque-limited simple pendulum: swing-ups with at most 1 N m, 50 and 200 Hz.

What is published as commanded is what the controller asked for; the drive was told by the same
loop. The model has inertia and weight as their authors identified them.
"""

from __future__ import annotations

from collections.abc import Sequence

from gfm.core import CommandKind, Trajectory
from public.source import PublicSet, Reader, Repository
from public.tables import columns, stamps

_REPOSITORY = Repository(
    name="dfki-ric-underactuated-lab/torque_limited_simple_pendulum",
    commit="ed17ea2d32a35ad944944ca03ef57693e2986732",
    licence="BSD-3-Clause",
)
_JOINT = "pivot"
#: results/control_method_pd/system_identification: inertia at the pivot, kg m^2, and m c, kg m.
_INERTIA, _MOMENT, _REACH_M = 6.259e-2, 1.022e-1, 0.5
_MODEL = """\
<mujoco model="simple_pendulum">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="RK4"/>
  <worldbody><body>
    <inertial pos="0 0 -{reach:g}" mass="{mass:.9g}"
      diaginertia="{inertia:.9g} {inertia:.9g} 1e-3"/>
    <joint name="pivot" axis="0 1 0"/>
  </body></worldbody>
  <actuator><motor name="pivot" joint="pivot" ctrlrange="-4 4"/></actuator>
</mujoco>
"""
_RUNS = {
    "energy_shaping": (
        "e1844e56f87cf763bdecb3f6f7e5b622a9a3b2d71e907b48ed6148b0a059c209",
        "503dceac0c5098aaff4ee8375422a44ad4aebdb47d308aa8578c34dac09f9762",
    ),
    "ilqr": (
        "f678b8650c167b04476be244f1b2d807d3e0949c5d7b7fa58522164bdcad0afe",
        "f5847d66e54fe917f34ee2184bd219f31fc9e112ef415371593113b1b113b4c3",
    ),
    "sac": (
        "e2bfed62046a1bfdbfc8ff5322afd54acbf10521a683668c30ee39b241ea20d9",
        "d3b2796e1efabd8b629535f4eb69b4473505c1588cb5d008a766328332e98bdc",
    ),
}


def model(_read: Reader) -> str:
    """Returns the pendulum without friction: its weight hangs at the rod's end."""
    mass = _MOMENT / _REACH_M
    return _MODEL.format(reach=_REACH_M, mass=mass, inertia=_INERTIA - mass * _REACH_M**2)


def recording(name: str, measured: bytes, told: bytes) -> Trajectory:
    """Returns a run of two tables: what was measured, and what was asked for."""
    found, asked = columns(measured), columns(told)
    return Trajectory(
        name=name,
        joint_names=(_JOINT,),
        stamp_ns=stamps(found["time"]),
        position=found["position"][:, None],
        velocity=found["velocity"][:, None],
        effort=found["torque"][:, None],
        command_kind=CommandKind.EFFORT,
        command_stamp_ns=stamps(asked["time"]),
        command=asked["torque"][:, None],
    )


def _path(run: str, which: str) -> str:
    return f"results/control_method_{run}/data_{which}.csv"


def _recordings(read: Reader) -> Sequence[Trajectory]:
    return [
        recording(run, read(_path(run, "measured")), read(_path(run, "desired"))) for run in _RUNS
    ]


SETS = (
    PublicSet(
        name="simple_pendulum",
        robot="pendulum, torque commands",
        repository=_REPOSITORY,
        files={
            _path(run, which): sha
            for run, pair in _RUNS.items()
            for which, sha in zip(("measured", "desired"), pair, strict=True)
        },
        recordings=_recordings,
        model=model,
        held_out=("sac",),
        known=frozenset({("coulomb_friction", _JOINT), ("viscous_friction", _JOINT)}),
        note="known: the authors' 0.184 atan(100 v) + 0.047 v, N m",
    ),
)
