"""`gfm diagnose` from files to files, on a pendulum that another simulation recorded."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.cli import main
from gfm.core import CommandKind, Trajectory
from gfm.recording.writer import write_recording

EPOCH_NS = 1_700_000_000_000_000_000
PENDULUM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step}" integrator="RK4"/>
  <worldbody>
    <body name="arm">
      <joint name="a" axis="0 1 0" damping="{damping}" armature="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/>
    </body>
  </worldbody>
  <actuator><position name="a" joint="a" kp="20" kv="1"/></actuator>
</mujoco>
"""
DAMPING, MISSING = 0.2, 0.8


def recording(name: str, seed: int, missing: float) -> Trajectory:
    """Returns 4 s of a pendulum whose damping is larger by `missing` than its model's."""
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(step=0.0005, damping=DAMPING + missing))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    ticks = np.arange(400)
    command = 0.3 * np.sin(2 * np.pi * 0.5 * 0.01 * ticks + rng.uniform(0, 6))
    command += 0.2 * np.sin(2 * np.pi * 1.3 * 0.01 * ticks + rng.uniform(0, 6))
    data.qpos[:] = command[0]
    position = []
    for setpoint in command:
        position.append(data.qpos.copy())
        data.ctrl[:] = setpoint
        mujoco.mj_step(model, data, nstep=20)
    stamp_ns = EPOCH_NS + ticks * 10_000_000
    return Trajectory(
        name=name,
        joint_names=("a",),
        stamp_ns=stamp_ns,
        position=np.array(position) + rng.normal(0.0, 1e-4, (400, 1)),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=command[:, None],
    )


def files(folder: Path, missing: float, count: int = 3) -> tuple[list[str], str]:
    """Returns the paths of recordings and model."""
    paths = []
    for seed in range(count):
        path = folder / f"motion_{seed}.mcap"
        write_recording(path, recording(path.stem, seed, missing))
        paths.append(str(path))
    model = folder / "pendulum.xml"
    model.write_text(PENDULUM.format(step=0.002, damping=DAMPING))
    return paths, str(model)


def test_a_missing_effect_is_named_and_the_model_corrected(tmp_path, capsys):
    paths, model = files(tmp_path, MISSING)
    out = tmp_path / "out"
    argv = ["diagnose", *paths[:2], "--holdout", paths[2], "--model", model, "--out", str(out)]
    assert main([*argv, "--seed", "3"]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["schema"] == "gfm.diagnosis/1"
    assert report["verdict"] == "explained"
    assert [(e["effect"], e["joints"]) for e in report["effects"]] == [("viscous_friction", ["a"])]
    assert report["effects"][0]["parameters"]["coefficient"]["value"] == pytest.approx(0.8, 0.02)
    assert report["error"]["after"] < 1.5 * report["error"]["noise_floor"]
    corrected = mujoco.MjModel.from_xml_path(str(out / "corrected.xml"))
    assert corrected.dof_damping.ravel()[0] == pytest.approx(DAMPING + MISSING, 0.02)
    roles = [file["role"] for file in report["provenance"]["files"]]
    assert roles == ["model", "recording", "recording", "held-out recording"]
    assert report["provenance"]["seed"] == 3
    printed = capsys.readouterr()
    assert "Explained" in printed.out
    assert "measuring the nominal model" in printed.err
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_a_model_that_is_right_has_no_gap(tmp_path):
    paths, model = files(tmp_path, 0.0, count=1)
    out = tmp_path / "out"
    assert main(["diagnose", *paths, "--model", model, "--out", str(out)]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["verdict"] == "no_gap"
    assert report["effects"] == []
    assert any("the only recording" in note for note in report["notes"])


def test_a_second_diagnosis_replaces_the_first_one(tmp_path):
    paths, model = files(tmp_path, 0.0, count=1)
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.json").write_text("{}")
    (out / "mine.txt").touch()
    assert main(["diagnose", *paths, "--model", model, "--out", str(out)]) == 0
    assert json.loads((out / "report.json").read_text())["verdict"] == "no_gap"
    assert (out / "mine.txt").exists()


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["{0}", "{0}", "--model", "{model}"], "{0}: given twice"),
        (["{0}", "{copy}", "--model", "{model}"], "{0} and {copy} are the same"),
        (["{0}", "--holdout", "{copy}", "--model", "{model}"], "{0} and {copy} are the same"),
        (["{0}", "--model", "{0}"], "model {0}: "),
        (["{0}", "--model", "{model}", "--command", "/none"], "{0}: topic /none: is missing"),
        (["{0}", "--model", "{model}", "--joint-states", "/none"], "{0}: topic /none: is missing"),
        (["{0}", "--model", "{model}", "--out", "{0}"], "{0}: is a file; expected a folder"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_leaves_nothing(tmp_path, capsys, argv, message):
    paths, model = files(tmp_path, 0.0, count=1)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(Path(paths[0]).read_bytes())
    before = sorted(tmp_path.iterdir())
    words = [word.format(paths[0], model=model, copy=copy) for word in argv]
    out = [] if "--out" in words else ["--out", str(tmp_path / "out")]
    assert main(["diagnose", *words, *out]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("error: " + message.format(paths[0], copy=copy))
    assert sorted(tmp_path.iterdir()) == before
