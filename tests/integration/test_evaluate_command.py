"""`gfm evaluate` from a policy's file to report and films."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from gfm.api.films.renderer import NoFilmError
from gfm.cli import main
from gfm.core import EnvironmentSpec, UnknownNameError, Weights
from gfm.envs.registry import EnvironmentSettings, make_environment
from gfm.experiments import film
from gfm.experiments.film import write_film
from gfm.policies import forces_path, shipped_policy
from gfm.recording.weights_file import write_weights
from gfm.rl.learner_state import LearnerSettings, init_learner, policy_tensors
from gfm.service.force_files import read_forces

#: Of ten goals once, so many at least; the share that was measured is nearer to all of them.
POLICIES = {"position": 8, "pose": 8}


def policy_file(path, spec):
    """A policy that has learned nothing: its arm stays near where it is."""
    tensors = policy_tensors(init_learner(spec, LearnerSettings(), seed=0))
    weights = Weights(version=7, created_ns=0, spec_digest=spec.digest, tensors=tensors)
    write_weights(path, weights)
    return path


@pytest.fixture(scope="module")
def spec():
    return make_environment("position_matching", EnvironmentSettings(), num_envs=1, seed=0).spec


def test_evaluates_reports_and_degrades_without_a_renderer(tmp_path, capsys, spec, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "no_such_backend")
    policy_file(tmp_path / "checkpoints" / "policy.npz", spec)
    out = tmp_path / "out"
    words = ["--task", "position", "--policy", str(tmp_path), "--trials", "1", "--json"]
    assert main(["evaluate", *words, "--out", str(out)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((out / "report.json").read_text())
    assert document["success"]["of"] == 10
    assert document["provenance"]["policy_version"] == 7
    assert document["films"] == []
    assert len(document["notes"]) == 1
    assert "no_such_backend" in document["notes"][0]
    assert sorted(path.name for path in out.iterdir()) == ["report.html", "report.json"]


@pytest.mark.parametrize("task", sorted(POLICIES))
def test_the_policy_that_comes_with_gfm_solves_its_task(capsys, task):
    words = ["evaluate", "--task", task, "--trials", "1", "--seed", "11", "--json"]
    assert main(words) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["success"]["of"] == 10
    assert document["success"]["reached"] >= POLICIES[task]
    assert shipped_policy(f"{task}_matching").stat().st_size < 1e6


def test_forces_that_come_with_gfm_are_called_by_name(tmp_path, monkeypatch):
    for number in (1, 2, 3):
        path = forces_path(f"coulomb_j6_{number}")
        assert path.stat().st_size < 1e6
        assert read_forces(path).forced_joints == ("right_j6",)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "coulomb_j6_1").touch()
    assert forces_path("coulomb_j6_1") == Path("coulomb_j6_1")  # one's own comes first
    assert forces_path("another.npz") == Path("another.npz")


def test_a_task_without_a_policy_is_refused():
    with pytest.raises(UnknownNameError, match="unknown policy 'joint_tracking'; available: "):
        shipped_policy("joint_tracking")


def for_another_task(path):
    spec = EnvironmentSpec(name="pose_matching", observation_size=9, action_size=7)
    policy_file(path, spec)


@pytest.mark.parametrize(
    ("prepare", "message"),
    [
        (lambda path: None, "no such file, expected gfm.weights/1"),  # noqa: ARG005
        (for_another_task, "maps 9 observations to 7 actions .* expected 270 to 7 for position"),
        (lambda path: path.write_bytes(b"PK\x03\x04 half"), "damaged"),
        (lambda path: path.mkdir(), "a folder without policy.npz or checkpoints/policy.npz"),
    ],
)
def test_a_policy_of_no_use_is_one_line_and_writes_nothing(tmp_path, capsys, prepare, message):
    given = tmp_path / "given.npz"
    prepare(given)
    out = tmp_path / "out"
    words = ["--task", "position", "--policy", str(given), "--out", str(out)]
    assert main(["evaluate", *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(message, error)
    assert not out.exists()


def test_a_film_shows_every_moment(tmp_path):
    av = pytest.importorskip("av", reason="needs the extra `video`")
    env = make_environment("position_matching", EnvironmentSettings(), num_envs=1, seed=0)
    env.reset()
    model = env._problem.nominal
    path = tmp_path / "film.mp4"
    try:
        write_film(path, model, np.repeat(env.qpos, 6, axis=0), env.goal[0], 0.025)
    except NoFilmError as error:
        pytest.skip(str(error))
    with av.open(str(path)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == 6
    assert frames[0].shape == (film._HEIGHT, film._WIDTH, 3)
    assert frames[0].std() > 10.0
