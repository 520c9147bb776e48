"""`gfm diagnose` from files to files, on a pendulum that another simulation recorded."""

from __future__ import annotations

import html
import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.cli import main
from gfm.core import CommandKind, Trajectory, Weights
from gfm.diagnosis.data.segmentation import cut, measure_noise
from gfm.diagnosis.output.result import ModelPair, NamedEffect, ParameterEstimate
from gfm.effects import EffectInstance, find_effect
from gfm.recording.writer import write_recording
from gfm.report.files import model_texts, write_texts
from gfm.service.force_files import write_forces
from gfm.service.model_files import read_model
from gfm.service.ranges_file import read_ranges
from gfm.sim.features import make_features
from gfm.sim.hybrid import HybridModel
from gfm.sim.plant import make_plant
from gfm.sim.predict import predict
from gfm.sim.replay import make_replay

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


def recording(name: str, seed: int, missing: float, ticks: int = 400) -> Trajectory:
    """Returns so many hundredths of a second of a pendulum with more damping than its model."""
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(step=0.0005, damping=DAMPING + missing))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    tick = np.arange(ticks)
    command = 0.3 * np.sin(2 * np.pi * 0.5 * 0.01 * tick + rng.uniform(0, 6))
    command += 0.2 * np.sin(2 * np.pi * 1.3 * 0.01 * tick + rng.uniform(0, 6))
    data.qpos[:] = command[0]
    position = []
    for setpoint in command:
        position.append(data.qpos.copy())
        data.ctrl[:] = setpoint
        mujoco.mj_step(model, data, nstep=20)
    stamp_ns = EPOCH_NS + tick * 10_000_000
    return Trajectory(
        name=name,
        joint_names=("a",),
        stamp_ns=stamp_ns,
        position=np.array(position) + rng.normal(0.0, 1e-4, (ticks, 1)),
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
    page = (out / "report.html").read_text()
    assert "data:video/mp4" in page or "<p>no film: " in page
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


def table(folder: Path, run: Trajectory) -> str:
    """Writes a recording as a table, as other people have it; returns its path."""
    columns = {
        "t": 1e-9 * (run.stamp_ns - run.stamp_ns[0]),
        "a_pos": run.position[:, 0],
        "a_cmd": run.command[:, 0],
    }
    path = folder / f"{run.name}.csv"
    rows = np.stack([*columns.values()], axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.9f")
    return str(path)


def test_tables_are_diagnosed_by_the_mapping_that_is_guessed_and_shown(tmp_path, capsys):
    _, model = files(tmp_path, MISSING, count=0)
    train, held = (table(tmp_path, recording(f"run{i}", i, MISSING)) for i in range(2))
    out = tmp_path / "out"
    argv = ["diagnose", train, "--holdout", held, "--model", model, "--out", str(out), "--no-film"]
    assert main([*argv, "--yes", "--minutes", "0.01"]) == 0
    assert 'position = "a_pos"' in capsys.readouterr().out
    report = json.loads((out / "report.json").read_text())
    assert report["error"]["before"] > 10.0 * report["error"]["noise_floor"]
    assert report["provenance"]["in_memory"]["held-out recording"] == ["run1"]
    assert main(argv) == 2
    assert "not an MCAP file" in capsys.readouterr().err


LOAD = EffectInstance(
    effect=find_effect("load_dependent_friction"), joints=("a",), values={"coefficient": 0.25}
)


def files_of_a_robot_beyond_mjcf(folder: Path) -> tuple[list[str], str]:
    """Returns what `files` returns; the robot's friction grows with its load.

    Predicted by the library itself, on far shorter steps: this is about files, not about laws.
    """
    paths, model = files(folder, 0.0)
    spec = mujoco.MjSpec.from_file(model)
    spec.option.timestep = 1e-4
    plant = make_plant(spec, ("a",), [LOAD])
    for seed, path in enumerate(paths):
        clean = recording(Path(path).stem, seed, 0.0)
        noise = np.random.default_rng(seed).normal(0.0, 1e-4, clean.position.shape)
        (whole,) = cut(clean, 0, measure_noise([clean]), [(0, len(clean.stamp_ns))])
        told = predict([plant], [replace(whole, initial_velocity=np.zeros(1))])[0][0]
        write_recording(Path(path), replace(clean, position=told.position + noise))
    return paths, model


@pytest.mark.slow
def test_what_stands_beside_the_model_is_no_gap(tmp_path, capsys):
    paths, model = files_of_a_robot_beyond_mjcf(tmp_path)
    estimate = ParameterEstimate(value=0.25, unit="1", ci95=None)
    known = NamedEffect(
        effect="load_dependent_friction",
        joints=("a",),
        parameters={"coefficient": estimate},
        confidence=1.0,
        native=False,
    )
    pair = ModelPair(xml=Path(model).read_text(), effects=(known,))
    write_texts(tmp_path, model_texts("pendulum", pair))
    out = tmp_path / "out"
    argv = [
        "diagnose",
        "--no-film",
        *paths[:2],
        "--holdout",
        paths[2],
        "--model",
        model,
        "--out",
        str(out),
    ]
    assert main(argv) == 0
    report = json.loads((out / "report.json").read_text())
    assert (report["verdict"], report["effects"]) == ("no_gap", [])
    read = [Path(file["path"]).name for file in report["provenance"]["files"]]
    assert read[:2] == ["pendulum.xml", "pendulum.effects.json"]
    assert read_model(out / "corrected.xml").effects == (LOAD,)
    said = capsys.readouterr().err
    assert "with pendulum.effects.json beside it: load_dependent_friction on a" in said


@pytest.mark.slow
def test_a_diagnosis_finds_no_gap_in_the_pair_that_another_one_wrote(tmp_path):
    paths, nominal = files_of_a_robot_beyond_mjcf(tmp_path)
    verdicts = []
    for name in ("once", "twice"):
        out = tmp_path / name
        argv = ["diagnose", "--no-film", *paths[:2], "--holdout", paths[2], "--model", nominal]
        assert main([*argv, "--out", str(out)]) == 0
        report = json.loads((out / "report.json").read_text())
        verdicts.append((report["verdict"], [e["effect"] for e in report["effects"]]))
        nominal = str(out / "corrected.xml")
    assert verdicts == [("explained", ["load_dependent_friction"]), ("no_gap", [])]


def test_a_model_that_is_right_has_no_gap(tmp_path):
    paths, model = files(tmp_path, 0.0, count=1)
    out = tmp_path / "out"
    assert main(["diagnose", "--no-film", *paths, "--model", model, "--out", str(out)]) == 0
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
    assert main(["diagnose", "--no-film", *paths, "--model", model, "--out", str(out)]) == 0
    assert json.loads((out / "report.json").read_text())["verdict"] == "no_gap"
    assert (out / "mine.txt").exists()


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["{0}", "{0}", "--model", "{model}"], "{0}: given twice"),
        (["{0}", "--model", "{model}", "--minutes", "0"], "minutes is 0, expected more than 0"),
        (["{0}", "{copy}", "--model", "{model}"], "{0} and {copy} are the same"),
        (["{0}", "--holdout", "{copy}", "--model", "{model}"], "{0} and {copy} are the same"),
        (["{0}", "--since", "{0}", "--model", "{model}"], "{0}: given twice"),
        (["{0}", "--since", "{copy}", "--model", "{model}"], "{0} and {copy} are the same"),
        (["{0}", "--since", "{other}", "--model", "{model}"], "{other}: joints b; expected those"),
        (["{0}", "--since", "{none}", "--model", "{model}"], "{none}: "),
        (["{0}", "--model", "{0}"], "model {0}: "),
        (["{0}", "--model", "{model}", "--command", "/none"], "{0}: topic /none: is missing"),
        (["{0}", "--model", "{model}", "--joint-states", "/none"], "{0}: topic /none: is missing"),
        (["{0}", "--model", "{model}", "--out", "{0}"], "{0}: is a file; expected a folder"),
        (["{0}", "--model", "{model}", "--unit", "rad"], "--unit; expected --yes, to read files"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_leaves_nothing(tmp_path, capsys, argv, message):
    paths, model = files(tmp_path, 0.0, count=1)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(Path(paths[0]).read_bytes())
    other, none = tmp_path / "other.mcap", tmp_path / "none.mcap"
    write_recording(other, replace(recording("other", 7, 0.0), joint_names=("b",)))
    named = {"model": model, "copy": copy, "other": other, "none": none}
    before = sorted(tmp_path.iterdir())
    words = [word.format(paths[0], **named) for word in argv]
    out = [] if "--out" in words else ["--out", str(tmp_path / "out")]
    assert main(["diagnose", *words, *out]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("error: " + message.format(paths[0], **named))
    assert sorted(tmp_path.iterdir()) == before


def two_sets(folder: Path) -> tuple[list[str], list[str], str]:
    """Returns recordings of today, those of a robot with less damping, and the model."""
    paths = []
    for seed, missing in enumerate((0.8, 0.8, 0.8, 0.4, 0.4)):
        path = folder / f"motion_{seed}.mcap"
        write_recording(path, recording(path.stem, seed, missing, ticks=600))
        paths.append(str(path))
    model = folder / "pendulum.xml"
    model.write_text(PENDULUM.format(step=0.002, damping=DAMPING))
    return paths[:3], paths[3:], str(model)


def test_what_changed_since_earlier_recordings_is_told_first(tmp_path, capsys):
    now, before, model = two_sets(tmp_path)
    out = tmp_path / "out"
    argv = [
        "diagnose",
        "--no-film",
        *now[:2],
        "--holdout",
        now[2],
        "--since",
        *before,
        "--model",
        model,
    ]
    assert main([*argv, "--out", str(out)]) == 0
    report = json.loads((out / "report.json").read_text())
    told = report["changes"]
    assert told["sentence"].startswith("Viscous friction of a up by 6")  # from 0.6 to 1.0
    assert told["sets"] == [["motion_3", "motion_4"], ["motion_0", "motion_1"]]
    (amount,) = told["amounts"]
    assert amount["course"] == "changes"
    assert amount["values"] == pytest.approx([0.4, 0.8], rel=0.03)
    (effect,) = report["effects"]
    assert effect["parameters"]["coefficient"]["value"] == pytest.approx(0.8, rel=0.02)
    (drawn,) = read_ranges(out / "ranges.toml")
    assert drawn.low["coefficient"] < 0.4 < 0.8 < drawn.high["coefficient"]
    roles = [file["role"] for file in report["provenance"]["files"]]
    assert roles[-2:] == ["earlier recording"] * 2
    assert told["sentence"] in capsys.readouterr().out
    assert html.escape(told["sentence"]) in (out / "report.html").read_text()


def learned_forces(folder: Path, joint: str = "a", share: float = 0.4) -> str:
    """Returns the path of a force model that always gives `share` of its 5 N m."""
    model = mujoco.MjModel.from_xml_string(
        PENDULUM.format(step=0.002, damping=DAMPING).replace('"a"', f'"{joint}"')
    )
    hybrid = HybridModel(models={CommandKind.POSITION: model}, control_period_s=0.02)
    seen = replace(recording("seen", 0, 0.0), joint_names=(joint,))
    features = make_features(hybrid.layout, [make_replay(hybrid, seen)], 5)
    size, hidden = features.size, 2
    tensors = {
        "shift": np.zeros(size),
        "scale": np.ones(size),
        "first.weight": np.zeros((hidden, size)),
        "first.bias": np.zeros(hidden),
        "norm.weight": np.ones(hidden),
        "norm.bias": np.zeros(hidden),
        "mean.weight": np.zeros((1, hidden)),
        "mean.bias": np.full(1, share),
        "stddev.weight": np.zeros((1, hidden)),
        "stddev.bias": np.zeros(1),
    }
    single = {name: tensor.astype(np.float32) for name, tensor in tensors.items()}
    path = folder / f"forces_{joint}.npz"
    weights = Weights(version=1, created_ns=0, spec_digest="", tensors=single)
    write_forces(path, hybrid, features, weights)
    return str(path)


def test_learned_forces_are_named_beside_the_verdict(tmp_path, capsys):
    paths, model = files(tmp_path, 0.0, count=3)
    out = tmp_path / "out"
    argv = ["diagnose", "--no-film", *paths, "--model", model, "--out", str(out)]
    assert main([*argv, "--gfm", learned_forces(tmp_path)]) == 0
    report = json.loads((out / "report.json").read_text())
    assert (report["verdict"], report["effects"]) == ("no_gap", [])
    told = report["gfm"]
    assert [(e["effect"], e["joints"]) for e in told["effects"]] == [("torque_offset", ["a"])]
    assert told["effects"][0]["parameters"]["torque"]["value"] == pytest.approx(2.0, rel=1e-3)
    assert told["named_share"] == pytest.approx(1.0, abs=1e-3)
    assert report["provenance"]["files"][-1]["role"] == "force model"
    assert "the recordings support none" in " ".join(capsys.readouterr().out.split())
    assert "What the learned forces say" in (out / "report.html").read_text()


def test_forces_of_another_robot_and_other_files_are_refused_in_one_line(tmp_path, capsys):
    paths, model = files(tmp_path, 0.0, count=1)
    argv = [
        "diagnose",
        "--no-film",
        *paths,
        "--model",
        model,
        "--out",
        str(tmp_path / "out"),
        "--gfm",
    ]
    other = learned_forces(tmp_path, joint="b")
    assert main([*argv, other]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == (f"error: {other}: force model of another robot: it observes b; recorded are a")
    assert main([*argv, model]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: {model}: damaged or no gfm.forces/1 file")
    assert not (tmp_path / "out").exists()
