"""`gfm fit` from files to forces, on a pendulum that SciPy integrates."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

import gfm
from gfm.cli import main
from gfm.core import BadInputError
from gfm.experiments.fit_curves import metric_rows
from gfm.recording.writer import write_recording
from gfm.service.force_files import read_forces
from pendulum import MODEL, PERIOD_S, swung

DRAG = 0.8


def recorded(folder: Path, seed: int) -> str:
    """Writes 6 s of a pendulum with a drag that its model lacks."""
    stamps = np.arange(0.0, 6.0, PERIOD_S)
    speeds = np.random.default_rng(seed).uniform(1.0, 5.0, 3)
    command = 0.25 * np.minimum(stamps, 1.0) * np.sin(np.outer(stamps, speeds) + seed).sum(axis=1)
    run = swung(command, seed=seed, noise=3e-4, torque=lambda _q, v: -DRAG * v)
    path = folder / f"run_{seed}.mcap"
    write_recording(path, run)
    return str(path)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A model and three recordings."""
    folder = tmp_path_factory.mktemp("pendulum")
    model = folder / "pendulum.xml"
    model.write_text(MODEL)
    return str(model), [recorded(folder, seed) for seed in range(3)]


def fit(files, out: Path, *flags: str) -> int:
    model, recordings = files
    return main(["fit", *recordings, "--model", model, "--out", str(out), *flags])


def errors(out: Path) -> tuple[float, float]:
    models = json.loads((out / "fit.json").read_text())["models"]
    assert [one["model"] for one in models] == ["nominal", "hybrid"]
    return models[0]["overall"], models[1]["overall"]


def test_the_warm_start_alone_needs_no_services(files, tmp_path, capsys):
    assert fit(files, tmp_path / "fit", "--minutes", "0") == 0
    nominal, hybrid = errors(tmp_path / "fit")
    assert hybrid < 0.3 * nominal
    forces = read_forces(tmp_path / "fit" / "forces.npz")
    assert forces.forced_joints == ("j",)
    said = capsys.readouterr().out
    assert "warm start (missing forces, regressed)" in said
    assert str(tmp_path / "fit" / "fit.json") in said


def test_a_program_fits_what_it_has_loaded(files, tmp_path):
    model, recordings = files
    runs = gfm.load(recordings)
    fitted = gfm.fit(model, runs[:-1], holdout=runs[-1], folder=tmp_path / "fit", minutes=0)
    assert fitted.after.overall < 0.3 * fitted.before.overall
    assert fitted.joint_names == ("j",)
    assert fitted.before.joints == (pytest.approx(fitted.before.overall),)
    assert (fitted.before.overall, fitted.after.overall) == errors(tmp_path / "fit")
    assert read_forces(fitted.forces).forced_joints == ("j",)
    with pytest.raises(BadInputError, match="exists; expected a new or an empty folder"):
        gfm.fit(model, runs, folder=tmp_path / "fit", minutes=0)


def test_services_learn_from_nothing_and_every_look_is_reported(files, tmp_path):
    assert fit(files, tmp_path / "fit", "--minutes", "0.1", "--from-nothing") == 0
    curve = json.loads((tmp_path / "fit" / "fit.json").read_text())["curve"]
    assert curve[0]["learner_step"] == 0
    assert curve[-1]["learner_step"] > 0
    assert curve[-1]["time_s"] > curve[0]["time_s"]
    nominal, hybrid = errors(tmp_path / "fit")
    assert hybrid <= 1.05 * nominal  # what does no good is not kept
    assert {path.name for path in (tmp_path / "fit" / "logs").iterdir()} >= {"learner.log"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["learner", "actor-0", "replay"])
def test_learning_goes_on_when_one_of_its_processes_is_killed(files, tmp_path, name):
    out = tmp_path / "fit"
    killed = []

    def kill_once_it_learns() -> None:
        deadline_s = time.monotonic() + 60.0
        while not metric_rows(out) and time.monotonic() < deadline_s:
            time.sleep(0.05)
        os.kill(int((out / "logs" / f"{name}.beat").read_text()), signal.SIGKILL)
        killed.append(len(metric_rows(out)))

    thread = Thread(target=kill_once_it_learns)
    thread.start()
    assert fit(files, out, "--minutes", "0.6", "--from-nothing") == 0
    thread.join()
    assert (out / "logs" / f"{name}.1.log").is_file()
    assert len(metric_rows(out)) > killed[0]
    assert json.loads((out / "fit.json").read_text())["curve"][-1]["learner_step"] > 0


def test_forces_are_judged_on_another_recording(files, tmp_path, capsys):
    model, recordings = files
    out = tmp_path / "fit"
    assert main(["fit", recordings[0], "--model", model, "--out", str(out)]) == 2
    assert "1 recording and none to hold out" in capsys.readouterr().err
    words = ["fit", recordings[0], "--model", model, "--out", str(out)]
    assert main([*words, "--holdout", recordings[0]]) == 2
    assert "are the same; expected different recordings" in capsys.readouterr().err
    assert not out.exists()


def test_a_folder_with_something_in_it_is_left_alone(files, tmp_path, capsys):
    (tmp_path / "note.txt").write_text("mine")
    assert fit(files, tmp_path) == 2
    assert "exists; expected a new or an empty folder" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]
