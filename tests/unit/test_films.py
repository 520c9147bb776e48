"""Films of a robot beside its models: what is shown, from where, and what is said without one."""

import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import gfm
from gfm.api.films.drawing import MOST_BYTES
from gfm.api.films.overlay import film_of
from gfm.api.films.renderer import NoFilmError
from gfm.api.films.rerun_file import sticks, write_rrd
from gfm.api.films.shapes import drawable
from gfm.api.films.view import OPENING, RATIO, camera_axes, make_view, moving_points
from gfm.core import CommandKind, ConfigError
from gfm.diagnosis.data.segmentation import WHOLE, all_segments, prepared
from gfm.diagnosis.output.errors import rollout_errors
from gfm.diagnosis.output.motion import Motion
from gfm.effects import EffectInstance, find_effect
from pendulum import MODEL, swung

TOLD = 0.4 * np.sin(2.0 * np.pi * np.arange(0.0, 3.0, 0.01))
DRAG = 0.8
#: An arm of two links without shapes: the frames of its bodies are 0.3 m apart.
BARE = """
<mujoco><worldbody><body name="upper">
  <inertial pos="0 0 -0.15" mass="1" diaginertia="0.01 0.01 0.01"/>
  <joint name="shoulder" axis="0 1 0"/>
  <body name="lower" pos="0 0 -0.3">
    <inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
    <joint name="elbow" axis="0 1 0"/>
  </body>
</body></worldbody></mujoco>
"""


def spec():
    return mujoco.MjSpec.from_string(MODEL)


def drag():
    return EffectInstance(
        effect=find_effect("viscous_friction"), joints=("j",), values={"coefficient": DRAG}
    )


def motion_along(runs, effects):
    problem = prepared(all_segments({CommandKind.POSITION: spec()}, runs, windows_s=WHOLE))
    return rollout_errors(problem, effects).worst(runs)


@pytest.fixture(scope="module")
def motion():
    run = swung(TOLD, seed=0, noise=1e-5, torque=lambda _q, v: -DRAG * v)
    return motion_along([run], [drag()])


def made_up(nominal, kind=CommandKind.POSITION, anew_s=float("inf")):
    still = np.zeros_like(nominal)
    return Motion(
        recording="run",
        kind=kind,
        joints=("j",),
        time_s=0.01 * np.arange(len(nominal)),
        measured=still,
        nominal=nominal,
        corrected=still,
        anew_s=anew_s,
    )


def test_the_corrected_model_moves_as_the_robot_and_the_nominal_one_does_not(motion):
    def error(model):
        return float(np.sqrt(np.mean((model - motion.measured) ** 2)))

    assert (motion.joints, motion.kind) == (("j",), CommandKind.POSITION)
    assert len(motion.time_s) == len(TOLD)
    assert error(motion.nominal) > 0.01
    assert error(motion.corrected) < 1e-4


def test_without_effects_both_models_are_one():
    run = swung(TOLD, seed=0, noise=1e-5)
    told = motion_along([run], [])
    assert np.array_equal(told.nominal, told.corrected)


def test_the_stretch_that_is_shown_is_the_worst_one():
    nominal = np.zeros((1000, 1))
    nominal[600:700] = 1.0
    shown = made_up(nominal).stretch(1.0)
    assert np.all(shown.nominal == 1.0)
    assert (shown.time_s[0], len(shown.time_s)) == (0.0, 100)


def test_a_short_recording_is_shown_whole():
    assert len(made_up(np.ones((50, 1))).stretch(8.0).time_s) == 50


def test_the_recording_with_the_largest_error_is_shown():
    drags = {"a": 0.1, "b": DRAG, "c": 0.4}
    runs = [
        replace(swung(TOLD, seed=0, noise=1e-5, torque=lambda _q, v, c=c: -c * v), name=name)
        for name, c in drags.items()
    ]
    assert motion_along(runs, [drag()]).recording == "b"


def test_a_difference_is_seen_from_the_side_and_small_ones_are_enlarged():
    model = drawable(spec())
    measured = 0.3 * np.sin(np.linspace(0.0, 6.0, 40))[:, None]
    near, far = (make_view(model, measured, measured + by) for by in (0.001, 0.5))
    assert near.azimuth % 180.0 == pytest.approx(90.0)  # the joint turns about y
    assert far.enlarged == 1
    assert near.enlarged > 10


def test_the_robot_is_inside_the_picture():
    model = drawable(mujoco.MjSpec.from_string(BARE))
    measured = np.random.default_rng(0).uniform(-2.0, 2.0, (50, 2))
    view = make_view(model, measured, measured + 0.1)
    points, radii = moving_points(model, measured)
    right, up, along = np.moveaxis((points - view.lookat) @ camera_axes(view.azimuth).T, 2, 0)
    away = view.distance_m + along
    assert np.all(np.abs(up) + radii < OPENING * away)
    assert np.all(np.abs(right) + radii < RATIO * OPENING * away)
    assert np.max(np.abs(up) / (OPENING * away)) > 0.5


def test_a_robot_without_shapes_gets_sticks():
    model = drawable(mujoco.MjSpec.from_string(BARE))
    assert model.ngeom == 2
    assert sorted(2.0 * model.geom_size[:, 1]) == pytest.approx([0.1, 0.3])


def test_a_robot_with_shapes_is_drawn_in_them():
    assert drawable(spec()).ngeom == spec().compile().ngeom


def test_a_film_is_an_mp4_that_fits_a_page(motion):
    try:
        film = film_of(motion, spec(), enlarge=True)
    except NoFilmError as error:
        pytest.skip(str(error))
    assert film.mp4[4:8] == b"ftyp"
    assert len(film.mp4) <= MOST_BYTES
    assert film.recording == motion.recording
    assert "furthest off, in real time" in film.caption


@pytest.fixture(scope="module")
def diagnosis():
    runs = [replace(swung(TOLD, seed=seed, noise=1e-4), name=f"run{seed}") for seed in range(2)]
    return gfm.diagnose(spec(), runs[:1], holdout=runs[1:], minutes=0.5)


def test_without_a_renderer_the_report_says_so_in_one_line(diagnosis, tmp_path, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    film = diagnosis.film()
    assert film.mp4 == b""
    assert film.missing.startswith("no film: nothing renders here (nonsense: ")
    assert "\n" not in film.missing
    diagnosis.save(tmp_path, film=film)
    assert "<p>no film: nothing renders here" in (tmp_path / "report.html").read_text()


def test_without_an_encoder_the_report_says_what_to_install(diagnosis, monkeypatch):
    monkeypatch.setattr("gfm.api.films.renderer.find_spec", lambda _: None)
    assert "gfm-sim2real[video]" in diagnosis.film().missing


def test_a_film_costs_no_answer(diagnosis):
    still = replace(diagnosis, answer=replace(diagnosis.answer, motion=None))
    assert still.film().missing == "no film: no held-out recording; nothing moves"


def test_without_rerun_its_file_says_what_to_install(motion, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ConfigError, match=r"gfm-sim2real\[rerun\]"):
        write_rrd(tmp_path / "motion.rrd", motion, spec().compile())
    assert not list(tmp_path.iterdir())


def test_a_rerun_file_has_every_measurement_of_every_robot(motion, tmp_path):
    pytest.importorskip("rerun")
    path = tmp_path / "motion.rrd"
    write_rrd(path, motion, spec().compile())
    assert [one.name for one in tmp_path.iterdir()] == ["motion.rrd"]
    command = [sys.executable, "-m", "rerun", "rrd", "stats", str(path)]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    for where in ("/position/j/measured", "/residual/j/corrected", "/robot/nominal"):
        assert where in told


def test_sticks_go_from_joint_to_joint_and_to_what_is_last():
    model = mujoco.MjSpec.from_string(BARE).compile()
    (lines,) = sticks(model, np.zeros((1, 2)))
    assert lines == pytest.approx(
        np.array([[[0, 0, 0], [0, 0, 0]], [[0, 0, 0], [0, 0, -0.3]], [[0, 0, -0.3], [0, 0, -0.4]]])
    )
