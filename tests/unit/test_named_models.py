"""Models as people have them: URDF, files without their meshes or actuators, robots by name."""

from __future__ import annotations

import difflib
import json
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

import gfm
from gfm.cli import main
from gfm.core import BadInputError, CommandKind, ConfigError, Trajectory
from gfm.recording import write_recording
from gfm.service.actuators import ActuatorRule
from gfm.service.named_model import named_model

INERTIAL = """<inertial><origin xyz="0 0 -0.15"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>"""
URDF = """
<robot name="arm">
  <link name="base"/>
  <link name="upper">{inertial}
    <visual><geometry><mesh filename="package://arm_description/meshes/upper.dae"/></geometry></visual>
    <collision><geometry><mesh filename="{mesh}"/></geometry></collision>
  </link>
  <link name="lower"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/>
    <inertia ixx="0.002" iyy="0.002" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="finger"><inertial><mass value="0.05"/>
    <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="30" velocity="3"/>
    <dynamics damping="{damping}" friction="0"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/><dynamics damping="0.3" friction="0"/></joint>
  <joint name="finger" type="revolute"><parent link="lower"/><child link="finger"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
    <mimic joint="elbow" multiplier="0.5"/></joint>
</robot>
"""
MESH = "package://arm_description/meshes/upper.obj"
RULE = "position:kp=30,kv=1"
TETRAHEDRON = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def urdf(
    folder: Path,
    mesh: str = MESH,
    inertial: str = INERTIAL,
    damping: float = 0.3,
    *,
    stiff: bool = False,
) -> Path:
    """Writes the arm; a stiff one has its shoulder alone."""
    path = folder / "arm_description" / "urdf" / "arm.urdf"
    path.parent.mkdir(parents=True, exist_ok=True)
    text = URDF.format(mesh=mesh, inertial=inertial, damping=damping)
    if stiff:
        for name, kind in (("elbow", "continuous"), ("finger", "revolute")):
            text = text.replace(f'name="{name}" type="{kind}"', f'name="{name}" type="fixed"')
    path.write_text(text)
    return path


def recorded(path: Path, seed: int) -> Trajectory:
    """Returns 3 s of the robot of a URDF file with the actuators of RULE, its finger apart."""
    (spec,) = gfm.load_nominal(path, RULE).specs.values()
    spec.option.timestep, spec.option.integrator = 0.001, mujoco.mjtIntegrator.mjINT_RK4
    model = spec.compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    time_s = 0.01 * np.arange(300)
    phases = rng.uniform(0.0, 6.0, (2, model.nu))
    command = 0.4 * np.sin(2 * np.pi * 0.5 * time_s[:, None] + phases[0])
    command += 0.2 * np.sin(2 * np.pi * 1.4 * time_s[:, None] + phases[1])
    position = []
    for setpoint in command:
        position.append(data.qpos[: model.nu].copy())
        data.ctrl[:] = setpoint
        mujoco.mj_step(model, data, nstep=10)
    stamp_ns = np.round(1e9 * time_s).astype(np.int64)
    return Trajectory(
        name=f"run{seed}",
        joint_names=("shoulder", "elbow")[: model.nu],
        stamp_ns=stamp_ns,
        position=np.array(position) + rng.normal(0.0, 1e-4, command.shape),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=command,
    )


def test_a_urdf_is_a_model_with_a_rule_for_its_actuators(tmp_path):
    nominal = gfm.load_nominal(urdf(tmp_path), RULE)
    (spec,) = nominal.specs.values()
    model = spec.compile()
    assert [model.actuator(i).name for i in range(model.nu)] == ["shoulder", "elbow"]
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], 30.0)
    np.testing.assert_allclose(model.actuator_biasprm[:, :3], [[0.0, -30.0, -1.0]] * 2)
    np.testing.assert_allclose(model.dof_damping[:2].reshape(2, -1)[:, 0], 0.3)
    np.testing.assert_allclose(model.jnt_actfrcrange[model.joint("shoulder").id], [-30.0, 30.0])
    assert list(nominal.made) == ["position"]
    assert nominal.about == (
        f"model {nominal.files[0]}: URDF, as MuJoCo reads it",
        f"model {nominal.files[0]}: meshes that are not there, or in no format that MuJoCo reads, "
        "are left out: 1 of 1 (upper.obj)",
        f"model {nominal.files[0]}: actuators added, {RULE}: shoulder, elbow",
    )


def test_a_mesh_of_the_package_is_found(tmp_path):
    path = urdf(tmp_path)
    mesh = tmp_path / "arm_description" / "meshes" / "upper.obj"
    mesh.parent.mkdir()
    mesh.write_text(TETRAHEDRON)
    found = named_model(path)
    assert found.made == ("URDF, as MuJoCo reads it",)
    assert found.spec.compile().nmesh == 1


def test_links_of_a_urdf_that_touch_at_rest_do_not_collide(tmp_path):
    path = urdf(tmp_path, damping=0.1)
    ball = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    text = path.read_text().replace('<link name="base"/>', f'<link name="base">{ball}</link>')
    path.write_text(text.replace(f'<mesh filename="{MESH}"/>', '<sphere radius="0.05"/>'))
    found = named_model(path)
    assert found.made[1] == "touch at rest, and so do not collide: upper and world"
    model = found.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def test_a_mass_that_comes_from_a_missing_mesh_is_refused(tmp_path):
    path = urdf(tmp_path, inertial="")
    with pytest.raises(BadInputError, match=r"mass of upper comes from the mesh .*upper\.obj, whi"):
        named_model(path)


def test_a_body_that_has_no_name_is_called_so(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><asset><mesh name="upper" file="upper.stl"/></asset><worldbody><body>'
        '<joint name="a"/><geom type="mesh" mesh="upper"/></body></worldbody></mujoco>'
    )
    with pytest.raises(BadInputError, match=r"mass of a body without a name comes from the mesh"):
        named_model(path)


def test_a_fixed_base_needs_no_mass(tmp_path):
    text = URDF.format(mesh=MESH, inertial=INERTIAL, damping=0.1)
    shape = f'<collision><geometry><mesh filename="{MESH}"/></geometry></collision>'
    path = tmp_path / "arm.urdf"
    path.write_text(text.replace('<link name="base"/>', f'<link name="base">{shape}</link>'))
    assert "left out: " in named_model(path).made[1]


def test_without_actuators_the_line_says_which_flag_to_give(tmp_path, capsys):
    path, run = urdf(tmp_path), tmp_path / "run.mcap"
    write_recording(run, recorded(path, 0))
    before = sorted(tmp_path.rglob("*"))
    argv = ["diagnose", str(run), "--model", str(path), "--out", str(tmp_path / "out")]
    assert main(argv) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: model {path}: no actuator drives a joint; expected one per")
    assert "(--actuators position:kp=50,kv=1, velocity:kv=5 or torque adds them)" in line
    assert sorted(tmp_path.rglob("*")) == before


def test_what_was_made_of_a_urdf_lies_beside_what_was_corrected(tmp_path):
    path = urdf(tmp_path, stiff=True)
    robot = urdf(tmp_path / "robot", damping=0.9, stiff=True)
    for seed in range(3):
        write_recording(tmp_path / "runs" / f"run{seed}.mcap", recorded(robot, seed))
    out = tmp_path / "out"
    runs = [str(tmp_path / "runs" / f"run{seed}.mcap") for seed in range(3)]
    argv = ["diagnose", *runs[:2], "--holdout", runs[2], "--model", str(path), "--out", str(out)]
    assert main([*argv, "--actuators", RULE]) == 0
    report = json.loads((out / "report.json").read_text())
    (effect,) = report["effects"]
    assert (effect["effect"], effect["joints"]) == ("viscous_friction", ["shoulder"])
    assert effect["parameters"]["coefficient"]["value"] == pytest.approx(0.6, rel=0.03)
    nominal, corrected = ((out / f"{name}.xml").read_text() for name in ("nominal", "corrected"))
    lines = list(difflib.ndiff(nominal.splitlines(), corrected.splitlines()))
    gone = [line for line in lines if line.startswith("- ")]
    assert any('name="shoulder"' in line for line in gone)
    assert not any("<body" in line for line in gone)
    assert mujoco.MjModel.from_xml_string(nominal).nu == 1


def test_every_command_takes_a_urdf(tmp_path, capsys):
    path, run = urdf(tmp_path), recorded(urdf(tmp_path), 0)
    rows = np.column_stack([run.time_s, run.position, run.command])
    header = "time,shoulder_pos,elbow_pos,shoulder_cmd,elbow_cmd"
    table = tmp_path / "run.csv"
    np.savetxt(table, rows, delimiter=",", header=header, comments="")
    given = ["--model", str(path), "--actuators", RULE]
    assert main(["import", str(table), *given, "--yes", "--out", str(tmp_path / "runs")]) == 0
    assert main(["doctor", str(path), str(tmp_path / "runs"), "--actuators", RULE]) == 0
    plan = ["--out", str(tmp_path / "plan"), "--for", "backlash", "--seconds", "8"]
    assert main(["excite", *given, *plan]) == 0
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "plan" / "nominal.xml")).nu == 2
    assert main(["doctor", str(path), str(tmp_path / "runs")]) == 2
    assert "--actuators position" in " ".join(capsys.readouterr().out.split())


GRIPPER_ARM = """
<mujoco>
  <compiler angle="radian" meshdir="assets" autolimits="true"/>
  <default>
    <default class="arm">
      <joint axis="0 1 0" damping="1" armature="0.1" range="-2 2"/>
      <position kp="100" kv="10" ctrlrange="-2 2"/>
      <default class="finger"><joint type="slide" axis="1 0 0" range="0 0.04"/></default>
      <default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default>
    </default>
  </default>
  <asset><mesh file="link1.obj"/><mesh name="shell" file="link1_c.stl"/></asset>
  <worldbody>
    <body name="link1" childclass="arm">
      <inertial pos="0 0 -0.1" mass="2" diaginertia="0.02 0.02 0.01"/>
      <joint name="joint1"/>
      <geom mesh="link1" class="visual"/>
      <geom type="mesh" mesh="shell"/>
      <body name="link2" pos="0 0 -0.3">
        <joint name="joint2"/><geom size="0.05" mass="1" pos="0 0 -0.1"/>
        <body><joint name="left" class="finger"/><geom size="0.01" mass="0.05"/></body>
        <body><joint name="right" class="finger"/><geom size="0.01" mass="0.05"/></body>
      </body>
    </body>
  </worldbody>
  <tendon><fixed name="split">
    <joint joint="left" coef="0.5"/><joint joint="right" coef="0.5"/>
  </fixed></tendon>
  <equality><joint joint1="left" joint2="right"/></equality>
  <actuator>
    <position class="arm" name="actuator1" joint="joint1"/>{second}
    <general name="grip" tendon="split" gainprm="100" biastype="affine" biasprm="0 -100 -10"/>
  </actuator>
  <keyframe><key name="home" qpos="0.1 0.2 0.01 0.01" ctrl="{ctrl}"/></keyframe>
</mujoco>
"""
SECOND = '<position class="arm" name="actuator2" joint="joint2"/>'


def gripper_arm(folder: Path, *, whole: bool) -> Path:
    path = folder / "arm.xml"
    ctrl = "0.1 0.2 0.01" if whole else "0.1 0.01"
    path.write_text(GRIPPER_ARM.format(second=SECOND if whole else "", ctrl=ctrl))
    return path


def test_a_menagerie_arm_works_without_its_meshes_and_keeps_what_it_has(tmp_path):
    nominal = gfm.load_nominal(gripper_arm(tmp_path, whole=True))
    (spec,) = nominal.specs.values()
    model = spec.compile()
    assert [model.actuator(i).name for i in range(model.nu)] == ["joint1", "joint2", "grip"]
    assert (model.nkey, model.ntendon, model.neq, model.nmesh) == (1, 1, 1, 0)
    np.testing.assert_allclose(model.key_ctrl, [[0.1, 0.2, 0.01]])
    assert model.body("link1").mass[0] == 2.0
    assert "left out: 2 of 2 (link1.obj, link1_c.stl)" in nominal.about[0]


def test_only_joints_that_nothing_moves_get_an_actuator(tmp_path):
    nominal = gfm.load_nominal(gripper_arm(tmp_path, whole=False), "position:kp=80")
    (spec,) = nominal.specs.values()
    model = spec.compile()
    assert [model.actuator(i).name for i in range(model.nu)] == ["joint1", "grip", "joint2"]
    np.testing.assert_allclose(model.actuator("joint2").biasprm[:3], [0.0, -80.0, 0.0])
    np.testing.assert_allclose(model.key_qpos, [[0.1, 0.2, 0.01, 0.01]])


def test_a_model_that_has_all_its_actuators_gets_none(tmp_path):
    nominal = gfm.load_nominal(gripper_arm(tmp_path, whole=True), "position:kp=80")
    assert nominal.about[1].endswith("actuators added, position:kp=80: none was missing")


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("position:kp=30", "position"),
        (RULE, "position"),
        ("velocity:kv=2.5", "velocity"),
        ("torque", "effort"),
    ],
)
def test_a_rule_is_what_it_states(text, kind):
    rule = ActuatorRule.read(text)
    assert (rule.kind, rule.words) == (kind, text)


@pytest.mark.parametrize(
    "text",
    ["", "servo", "position", "position:kv=1", "position:kp=0", "position:kp=x", "position:kp=nan",
     "position:kp=1,kd=1", "velocity", "velocity:kp=1", "torque:kp=1"],
)  # fmt: skip
def test_a_rule_that_states_nothing_is_refused(text):
    with pytest.raises(ConfigError, match="expected position:kp=50,kv=1, velocity:kv=5 or torque"):
        ActuatorRule.read(text)


def test_xacro_is_told_from_urdf(tmp_path):
    path = tmp_path / "arm.urdf.xacro"
    path.write_text('<robot xmlns:xacro="http://wiki.ros.org/xacro"><xacro:include a="b"/></robot>')
    with pytest.raises(BadInputError, match=r"is xacro; expected URDF \(xacro .* > robot\.urdf\)"):
        named_model(path)


@pytest.fixture
def robots(tmp_path, monkeypatch):
    """Puts a package with one robot, and one that cannot be had, in the place of the real one."""
    package = tmp_path / "site" / "robot_descriptions"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    path = gripper_arm(tmp_path, whole=True)
    says = "print('Cloning ...')"
    (package / "panda_mj_description.py").write_text(f"{says}\nMJCF_PATH = {str(path)!r}")
    (package / "gen3_description.py").write_text(f"{says}\nraise OSError('no network')")
    monkeypatch.syspath_prepend(str(package.parent))
    for name in [one for one in sys.modules if one.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    yield path
    for name in [one for one in sys.modules if one.startswith("robot_descriptions")]:
        del sys.modules[name]


@pytest.mark.parametrize("name", ["panda", "panda_mj_description"])
def test_a_robot_goes_by_its_name(robots, name):
    nominal = gfm.load_nominal(f"robot_descriptions:{name}")
    assert nominal.files == (robots,)
    assert nominal.about[0] == f"model {robots}: robot_descriptions:{name} is {robots}"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("pandaa", r"no such robot; expected .* \(the nearest: panda_mj_description"),
        ("gen3", r"could not be downloaded, .*; expected git and a network \(no network\)"),
    ],
)
@pytest.mark.usefixtures("robots")
def test_a_robot_that_cannot_be_had_is_one_line(name, words):
    with pytest.raises(ConfigError, match=words):
        gfm.load_nominal(f"robot_descriptions:{name}")


@pytest.mark.usefixtures("robots")
def test_what_a_download_prints_is_no_part_of_an_answer(capsys):
    gfm.load_nominal("robot_descriptions:panda")
    with pytest.raises(ConfigError):
        gfm.load_nominal("robot_descriptions:gen3")
    told = capsys.readouterr()
    assert (told.out, told.err) == ("", "Cloning ...\nCloning ...\n")


def test_a_bare_name_is_told_how_robots_are_named():
    with pytest.raises(BadInputError, match=r"expected .*, or robot_descriptions:sawyer$"):
        named_model("sawyer")
    with pytest.raises(BadInputError, match=r"no such file; expected MJCF or URDF$"):
        named_model("robots/sawyer")


def test_without_the_package_the_line_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    with pytest.raises(ConfigError, match="is missing; expected `pip install robot_descriptions`"):
        gfm.load_nominal("robot_descriptions:panda")
