"""An effect that another package offers, from its two files to a diagnosis and to stepping.

The page that explains how it is done is where the files come from.
"""

import importlib
import json
import re
import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gfm.cli import main
from gfm.core import CommandKind, ConfigError, Trajectory
from gfm.effects import EffectInstance, effect_library, find_effect
from gfm.recording.writer import write_recording
from gfm.report.words import effect_law
from gfm.service.model_files import read_model
from gfm.sim.batch import HybridBatch
from gfm.sim.hybrid import HybridModel
from gfm.sim.plant import make_plant, stepping_spec
from gfm.sim.predict import predict
from gfm.sim.rollout import rollouts
from gfm.sim.segment import Segment

PAGE = Path(__file__).parents[2] / "docs" / "effects.md"
INERTIA, STIFFNESS, DAMPING, SLOPE, NOISE = 0.02, 20.0, 1.0, 0.6, 2e-4
MODEL = f"""
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 0"/>
  <worldbody><body>
    <joint name="j" axis="0 0 1" armature="{INERTIA}"/>
    <geom size="0.01" mass="1e-6"/>
  </body></worldbody>
  <actuator><position name="j" joint="j" kp="{STIFFNESS}" kv="{DAMPING}"/></actuator>
</mujoco>
"""


def example(language):
    """Returns the first block of the page in a language."""
    found = re.search(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    return found[1]


def install(folder, monkeypatch, code, project):
    """Puts a package into a folder as pip would, and lets Python find it there."""
    about = tomllib.loads(project)["project"]
    module = about["name"].replace("-", "_")
    (folder / f"{module}.py").write_text(code)
    told = folder / f"{module}-{about['version']}.dist-info"
    told.mkdir()
    head = f"Metadata-Version: 2.1\nName: {about['name']}\nVersion: {about['version']}\n"
    (told / "METADATA").write_text(head)
    lines = [
        line
        for group, points in about["entry-points"].items()
        for line in (f"[{group}]", *(f"{name} = {value}" for name, value in points.items()))
    ]
    (told / "entry_points.txt").write_text("\n".join(lines) + "\n")
    monkeypatch.syspath_prepend(str(folder))
    importlib.invalidate_caches()
    effect_library.cache_clear()
    return module


@pytest.fixture
def installing(tmp_path, monkeypatch):
    """Yields `install`; takes everything out again."""
    modules, folder = [], tmp_path / "site"
    folder.mkdir()
    yield lambda *words: modules.append(install(folder, monkeypatch, *words))
    effect_library.cache_clear()
    for name in modules:
        sys.modules.pop(name, None)


def recording(seed, slope):
    """Returns 4 s of a joint with friction slope |q|, integrated by SciPy."""
    period, stamps = 0.01, np.arange(0.0, 4.0, 0.01)
    rng = np.random.default_rng(seed)
    waves = np.sin(np.outer(stamps, rng.uniform(1.0, 5.0, 3)) + rng.uniform(0.0, 6.0, 3))
    told = 0.3 * np.minimum(stamps, 1.0) * waves.sum(axis=1)

    def motion(time_s, state):
        index = min(int(np.floor(time_s / period + 1e-9)), len(told) - 1)
        q, v = state
        drive = STIFFNESS * (told[index] - q) - DAMPING * v
        return [v, (drive - slope * abs(q) * np.tanh(v / 1e-3)) / INERTIA]

    answer = solve_ivp(
        motion, (0.0, stamps[-1]), [0.0, 0.0], t_eval=stamps, max_step=0.01, rtol=1e-7, atol=1e-9
    )
    stamp_ns = np.round(stamps * 1e9).astype(np.int64)
    return Trajectory(
        name=f"run_{seed}",
        joint_names=("j",),
        stamp_ns=stamp_ns,
        position=(answer.y[0] + NOISE * rng.standard_normal(len(stamps)))[:, None],
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=told[:, None],
    )


@pytest.mark.slow
def test_the_example_is_named_on_data_and_goes_on_in_the_corrected_pair(
    tmp_path, installing, capsys
):
    installing(example("python"), example("toml"))
    model = tmp_path / "robot.xml"
    model.write_text(MODEL)
    paths = []
    for seed in range(3):
        paths.append(tmp_path / f"run_{seed}.mcap")
        write_recording(paths[-1], recording(seed, SLOPE))
    runs, out = [str(path) for path in paths], tmp_path / "out"
    argv = [
        "diagnose",
        "--no-film",
        *runs[:2],
        "--holdout",
        runs[2],
        "--model",
        str(model),
        "--out",
        str(out),
    ]
    assert main(argv) == 0
    report = json.loads((out / "report.json").read_text())
    assert [e["effect"] for e in report["effects"]] == ["cable_friction"]
    (found,) = report["effects"]
    assert found["parameters"]["slope"]["value"] == pytest.approx(SLOPE, rel=0.05)
    assert found["parameters"]["slope"]["unit"] == "N m/rad"
    assert "cable friction" in (out / "report.html").read_text()
    pair = read_model(out / "corrected.xml")
    assert [e.effect.name for e in pair.effects] == ["cable_friction"]
    assert predicts(pair, recording(2, SLOPE)) < 5.0 * NOISE
    again = ["diagnose", *runs, "--model", str(out / "corrected.xml"), "--out", str(tmp_path / "2")]
    assert main(again) == 0
    assert json.loads((tmp_path / "2" / "report.json").read_text())["verdict"] == "no_gap"
    capsys.readouterr()


def predicts(pair, run):
    """Returns the RMSE of hybrid stepping against a recording, rad."""
    models = {CommandKind.POSITION: stepping_spec(pair.spec, pair.effects).compile()}
    model = HybridModel(models=models, effects=pair.effects)
    (told,) = rollouts(model, [run])
    return float(np.sqrt(np.mean((told.position - run.position[told.first :]) ** 2)))


HEAD = "from gfm.effects import Effect, Parameter, Scope\nclass Mine(Effect):\n"
BODY = {
    "name": "'mine'",
    "parameters": "(Parameter(name='amount', unit='N m', lower=0.0, upper=1.0),)",
    "shown_by": "'any motion'",
}
METHODS = (
    "    def apply(self, spec, joints, values): pass\n"
    "    def probes(self, scales): return [[{'amount': 0.1}]]\n"
)
PROJECT = """
[project]
name = "mine"
version = "1.0"
[project.entry-points."gfm.effects"]
mine = "mine:Mine"
"""


def code(methods=METHODS, **changed):
    lines = [f"    {name} = {value}\n" for name, value in {**BODY, **changed}.items()]
    return HEAD + "".join(lines) + methods


WITHOUT_UNIT = BODY["parameters"].replace("'N m'", "''")
ENDLESS = BODY["parameters"].replace("1.0", "float('inf')")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("import not_there", "cannot be loaded (ModuleNotFoundError"),
        ("Mine = 3", "is 3; expected a subclass of gfm.effects.Effect"),
        ("class Mine: pass", "is <class 'mine.Mine'>; expected a subclass of gfm.effects.Effect"),
        (code(name="'payload'"), "is called 'payload'; expected a name that no other effect has"),
        (code(name="'My effect'"), "its name is 'My effect'; expected lower-case letters"),
        (code(shown_by="''"), "its shown_by is ''; expected the motion that shows it"),
        (code(scope="'joint'"), "its scope is 'joint'; expected JOINT, PAIR, LAST or ROBOT"),
        (
            code(seen_over="'time'"),
            "is seen over 'time'; expected one of velocity, position, drive",
        ),
        (code(parameters="()"), "its parameters are (); expected a tuple"),
        (code(parameters=WITHOUT_UNIT), "the unit of amount is ''; expected an SI unit"),
        (code(parameters=ENDLESS), "the bounds of amount are 0.0 and inf; expected two finite"),
        (code(parameters=f"{BODY['parameters']} * 2"), "amount, amount; expected each name once"),
        (code(valleys="('limit',)"), "'limit' is fixed or has valleys; expected one of its"),
        (code(methods=METHODS.splitlines()[0]), "does not define probes; expected the methods"),
        (code(methods=METHODS.splitlines()[1]), "changes nothing; expected stepwise, or one of"),
        (code(stepwise="True"), "is stepwise and has no torque; expected the torque"),
        (
            code(methods=METHODS.replace("0.1", "2.0")),
            "a probe is {'amount': 2.0}; expected values",
        ),
        (code(methods=METHODS.replace("amount", "size")), "a probe has size; expected amount"),
        (
            code(methods=METHODS.replace("'amount'", "scales.none")),
            "its probes cannot be made (AttributeError",
        ),
        (
            code() + "    def extra_friction(self, motion, values): return 0.0\n",
            "is native and evaluated at every step; expected native = False",
        ),
    ],
)
def test_an_effect_that_cannot_be_used_is_refused_in_one_line(installing, source, message):
    installing(source, PROJECT)
    with pytest.raises(ConfigError) as refused:
        effect_library()
    (line,) = str(refused.value).splitlines()
    assert line.startswith("effect mine:Mine of mine: ")
    assert message in line


def test_a_refusal_ends_a_command_with_one_line_and_status_2(installing, tmp_path, capsys):
    installing("import not_there", PROJECT)
    model, run = tmp_path / "robot.xml", tmp_path / "run.mcap"
    model.write_text(MODEL)
    write_recording(run, recording(0, 0.0))
    argv = ["diagnose", str(run), "--model", str(model), "--out", str(tmp_path / "out")]
    assert main(argv) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert len(said) == 1
    assert said[0].startswith("error: effect mine:Mine of mine: cannot be loaded")
    assert not (tmp_path / "out").exists()


FINE = '<option timestep="0.0002" integrator="RK4"'
STEPWISE = code(
    stepwise="True",
    native="False",
    methods=(
        "    def probes(self, scales): return [[{'amount': 0.1}]]\n"
        "    def torque(self, motion, values): return -values['amount'] * motion.position**3\n"
    ),
).replace("upper=1.0", "upper=100.0")


def test_a_force_that_mujoco_lacks_acts_in_predictions_and_in_stepping(installing):
    installing(STEPWISE, PROJECT)
    hard = EffectInstance(effect=find_effect("mine"), joints=("j",), values={"amount": 40.0})
    stamps = np.arange(0.0, 1.0, 0.01)

    def motion(_, state):
        return [
            state[1],
            (-STIFFNESS * state[0] - DAMPING * state[1] - 40.0 * state[0] ** 3) / INERTIA,
        ]

    truth = solve_ivp(motion, (0.0, 1.0), [0.5, 0.0], t_eval=stamps, rtol=1e-9, atol=1e-11).y[0]
    segment = Segment(
        time_s=stamps,
        position=truth[:, None],
        effort=None,
        kind=CommandKind.POSITION,
        command_time_s=np.zeros(1),
        command=np.zeros((1, 1)),
        initial_position=np.array([0.5]),
        initial_velocity=np.zeros(1),
        servo_gain=np.ones(1),
    )
    spec = mujoco.MjSpec.from_string(MODEL.replace("<option", FINE))
    ((told,),) = predict([make_plant(spec, ("j",), [hard])], [segment])
    np.testing.assert_allclose(told.position[:, 0], truth, atol=1e-3)
    models = {CommandKind.POSITION: stepping_spec(spec, [hard]).compile()}
    batch = HybridBatch(HybridModel(models=models, effects=(hard,)), 1)
    batch.reset(
        np.zeros(1, int), [models[CommandKind.POSITION]], np.array([[0.5]]), np.zeros((1, 1))
    )
    for period in range(1, 20):
        batch.step(np.zeros((1, 1)), np.zeros((1, 1)))
        assert batch.qpos[0, 0] == pytest.approx(truth[5 * period], abs=1e-3)


def test_the_report_says_what_an_own_effect_does_by_its_docstring(installing):
    installing(example("python"), example("toml"))
    law = "Dry friction that grows with the angle: a cable that is pressed against its guide."
    assert effect_law("cable_friction") == law


def test_the_page_names_every_effect_with_its_amounts_and_the_motion_that_shows_it():
    rows = {
        cells[1].strip(" `"): cells
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith("| `") and len(cells := line.split("|")) == 7
    }
    library = effect_library()
    assert set(rows) == set(library)
    for name, effect in library.items():
        _, _, parameters, _, acts, shown_by, _ = rows[name]
        told = [
            (parameter, unit)
            for names, unit in re.findall(r"((?:`\w+`(?:, )?)+) \(([^)]+)\)", parameters)
            for parameter in re.findall(r"`(\w+)`", names)
        ]
        assert told == [(p.name, p.unit) for p in effect.parameters], name
        assert shown_by.strip() == effect.shown_by, name
        beside = ("every step" in acts and "also" not in acts) or "predictions only" in acts
        assert beside is not effect.native, name
