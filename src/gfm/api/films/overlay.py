"""One robot three times in one picture: as measured, by the nominal and by the corrected model."""

from __future__ import annotations

import tempfile
from pathlib import Path

import mujoco
import numpy as np

from gfm.api.films.drawing import RATE_HZ
from gfm.api.films.renderer import draw
from gfm.api.films.shapes import drawable
from gfm.api.films.view import make_view
from gfm.core import CommandKind
from gfm.diagnosis.output.motion import Motion
from gfm.report.film import Film
from gfm.sim.layout import make_layout

#: Of a film, and how many times slower it shows what is begun anew every half second.
LENGTH_S, SLOWED = 8.0, 4
#: After which drawing is given up: a graphics library that hangs must not hold a report.
LONGEST_S = 30.0


def film_of(motion: Motion, spec: mujoco.MjSpec, *, enlarge: bool) -> Film:
    """Returns a film of the stretch in which the nominal model is furthest off.

    Args:
        motion: What is shown.
        spec: The nominal model for its kind of command.
        enlarge: Whether differences may be drawn larger than they are.

    Raises:
        NoFilmError: it cannot be drawn here; the text says why, in one line.
    """
    slowed = SLOWED if motion.kind is CommandKind.EFFORT else 1
    shown = motion.stretch(LENGTH_S / slowed)
    model = drawable(spec)
    layout = make_layout(model, shown.joints)
    at_s = np.arange(0.0, shown.time_s[-1], 1.0 / (RATE_HZ * slowed))
    measured, nominal, corrected = (
        np.stack([np.interp(at_s, shown.time_s, one) for one in joints.T], axis=1)
        for joints in (shown.measured, shown.nominal, shown.corrected)
    )
    view = make_view(model, layout.as_qpos(measured), layout.as_qpos(nominal))
    enlarged = view.enlarged if enlarge else 1
    models = [nominal] if np.array_equal(nominal, corrected) else [nominal, corrected]
    poses = [measured, *(measured + enlarged * (one - measured) for one in models)]
    with tempfile.TemporaryDirectory() as folder:
        mjb, pictures, mp4 = (Path(folder) / name for name in ("model.mjb", "p.npz", "film.mp4"))
        mujoco.mj_saveModel(model, str(mjb), None)
        camera = (*view.lookat, view.distance_m, view.azimuth, view.elevation)
        np.savez(pictures, qpos=layout.as_qpos(np.stack(poses, axis=1)), camera=camera)
        draw("gfm.api.films.drawing", [mjb, pictures, mp4], LONGEST_S)
        film = mp4.read_bytes()
    return Film(
        mp4=film,
        recording=motion.recording,
        length_s=float(shown.time_s[-1]),
        slowed=slowed,
        enlarged=enlarged,
        anew_s=motion.anew_s,
    )
