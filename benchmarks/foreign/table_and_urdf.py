"""A double pendulum as its builders have it: tables of one run each, and a URDF.

The tables are those of the DFKI double pendulum, design C.1, byte for byte: raw and filtered
columns side by side, joints by number. The URDF says what `models/double_pendulum_c1.xml` says, as
far as URDF can: rotors have no inertia in it.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from foreign.cutting import Sources

MODEL = Path(__file__).parents[2] / "models" / "double_pendulum_c1.xml"
_HEAD = """\
<robot name="double_pendulum">
  <link name="base"/>
"""
_JOINT = """\
  <joint name="{joint}" type="revolute">
    <parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{place}"/><axis xyz="{axis}"/>
    <limit lower="-6.5" upper="6.5" effort="{effort:g}" velocity="30"/>
  </joint>
  <link name="{child}">
    <inertial>
      <origin xyz="{centre}"/><mass value="{mass:.9g}"/>
      <inertia ixx="{xx:.9g}" iyy="{yy:.9g}" izz="{zz:.9g}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
"""


def make(folder: Path, sources: Sources) -> None:
    """Writes arm.urdf and run1.csv, run2.csv ... into a folder."""
    (folder / "arm.urdf").write_text(urdf())
    found = sorted((sources.data / "measured/dfki_double_pendulum").glob("C1_20230629-*.csv.gz"))
    for number, path in enumerate(sources.some(found), start=1):
        (folder / f"run{number}.csv").write_text("\n".join(sources.rows(path)) + "\n")


def urdf() -> str:
    """Returns the model as URDF: a chain of hinges whose inertias lie along its axes."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    links = ["base", *(model.body(body).name for body in range(1, model.nbody))]
    text = _HEAD
    for body in range(1, model.nbody):
        joint = model.body_jntadr[body]
        xx, yy, zz = model.body_inertia[body]
        text += _JOINT.format(
            joint=model.joint(joint).name,
            parent=links[model.body_parentid[body]],
            child=links[body],
            place=_numbers(model.body_pos[body]),
            axis=_numbers(model.jnt_axis[joint]),
            effort=model.actuator_ctrlrange[joint, 1],
            centre=_numbers(model.body_ipos[body]),
            mass=model.body_mass[body],
            xx=xx,
            yy=yy,
            zz=zz,
        )
    return f"{text}</robot>\n"


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)
