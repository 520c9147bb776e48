"""A motion as a file for Rerun: curves of every joint, residuals, and three robots of sticks.

Shape letters: T measurements, F pictures, J joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from gfm.core.checks import Array
from gfm.core.extras import needs
from gfm.diagnosis.output.motion import Motion
from gfm.sim.layout import make_layout

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint

NAME = "motion.rrd"
#: Robots are drawn so often at most, 1/s; curves have every measurement.
DRAWN_HZ = 25.0
_TIMELINE = "time"
#: Those of reports.
_COLOURS = {"measured": (110, 119, 129), "nominal": (213, 94, 0), "corrected": (0, 114, 178)}


def rerun_is_here() -> bool:
    """Returns whether the extra `rerun` is installed."""
    return find_spec("rerun") is not None


def write_rrd(path: Path, motion: Motion, model: mujoco.MjModel) -> None:
    """Writes the file, in one move.

    Args:
        path: Where to.
        motion: All of it is written.
        model: The nominal one, in which robots are drawn.

    Raises:
        ConfigError: the extra `rerun` is not installed.
    """
    with needs(f"{path}: it needs", "rerun", "rerun"):
        import rerun as rr

    part = path.with_name(f".{path.name}.part")
    with rr.RecordingStream("gfm_diagnosis", recording_id=motion.recording) as stream:
        stream.save(part, default_blueprint=_blueprint(motion))
        _write_curves(stream, motion)
        _write_robots(stream, motion, model)
    stream.disconnect()
    part.replace(path)


def _robots(motion: Motion) -> Mapping[str, Array]:
    """Returns joint positions by robot; without a corrected one that is the nominal one."""
    same = np.array_equal(motion.nominal, motion.corrected)
    names = ("measured", "nominal") if same else tuple(_COLOURS)
    return {name: getattr(motion, name) for name in names}


def _write_curves(stream: RecordingStream, motion: Motion) -> None:
    """Writes positions, and measured minus predicted, rad, of every joint."""
    import rerun as rr

    time = rr.TimeColumn(_TIMELINE, duration=motion.time_s)
    for name, joints in _robots(motion).items():
        curves = {"position": joints, "residual": motion.measured - joints}
        for kind, values in curves.items():
            if kind == "residual" and name == "measured":
                continue
            for joint, column in zip(motion.joints, values.T, strict=True):
                where = rr.new_entity_path([kind, joint, name])
                style = rr.SeriesLines(colors=_COLOURS[name], names=name)
                rr.log(where, style, static=True, recording=stream)
                scalars = rr.Scalars.columns(scalars=column)
                rr.send_columns(where, [time], scalars, recording=stream)


def _write_robots(stream: RecordingStream, motion: Motion, model: mujoco.MjModel) -> None:
    """Writes every robot as sticks from joint to joint, m in the frame of the world."""
    import rerun as rr

    step = max(int(len(motion.time_s) / (motion.time_s[-1] * DRAWN_HZ + 1.0)), 1)
    time = rr.TimeColumn(_TIMELINE, duration=motion.time_s[::step])
    layout = make_layout(model, motion.joints)
    for name, joints in _robots(motion).items():
        lines = sticks(model, layout.as_qpos(joints[::step]))
        pictures, each = lines.shape[:2]
        where = f"robot/{name}"
        style = rr.LineStrips3D.from_fields(colors=_COLOURS[name])
        rr.log(where, style, static=True, recording=stream)
        strips = rr.LineStrips3D.columns(strips=lines.reshape(-1, 2, 3).astype(np.float32))
        columns = strips.partition([each] * pictures)
        rr.send_columns(where, [time], columns, recording=stream)


def sticks(model: mujoco.MjModel, qpos: Array) -> Array:
    """Returns both ends of sticks that make a robot, m, shape (F, sticks, 2, 3).

    One from the frame of each body's parent to its own, and one to the centre of mass of what is
    last.

    Args:
        model: Of the robot.
        qpos: Positions, shape (F, nq).
    """
    data, last = mujoco.MjData(model), np.setdiff1d(np.arange(1, model.nbody), model.body_parentid)
    rows = []
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        links = np.stack([data.xpos[model.body_parentid[1:]], data.xpos[1:]], axis=1)
        ends = np.stack([data.xpos[last], data.xipos[last]], axis=1)
        rows.append(np.concatenate([links, ends]))
    return np.array(rows)


def _blueprint(motion: Motion) -> Blueprint:
    """Returns how it is laid out at first: the robots, beside curves of all joints."""
    import rerun as rr
    import rerun.blueprint as rrb

    def curves(kind: str) -> rrb.Grid:
        views = [
            rrb.TimeSeriesView(origin=rr.new_entity_path([kind, joint]), name=joint)
            for joint in motion.joints
        ]
        return rrb.Grid(*views, name=kind)

    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="robot", name="robot"),
            rrb.Tabs(curves("position"), curves("residual")),
        ),
        collapse_panels=True,
    )
