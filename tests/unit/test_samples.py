"""How samples of another simulator are judged: by the rules of the known-truth suite."""

import json

import pytest
import samples

ARM = """<mujoco><default><joint damping="1"/></default><worldbody>
<body><joint name="shoulder" axis="{axis}"/><body><joint name="elbow" axis="0 1 0"/></body></body>
</worldbody></mujoco>"""
HIDDEN = {"effect": "armature", "joints": ["elbow"], "parameters": {"inertia": 0.1}}
TOLD = HIDDEN | {
    "parameters": {"inertia": {"value": 0.11, "unit": "kg m^2", "ci95": [0.0, 0.2]}},
    "confidence": 0.8,
}


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(ARM.format(axis="0 1 0"))
    return path


def judged(case, model, hidden, named):
    """Returns the score of a case of which a report is there."""
    sample = {"id": "case", "robot": "arm2", "effects": hidden, "noise_floor": 0.5}
    error = {"before": 2.0, "after": 1.0, "noise_floor": 0.1}
    report = {"effects": named, "suspects": [], "verdict": "explained", "error": error}
    (model.parent / "truth.json").write_text(json.dumps(sample))
    out = case / "out"
    out.mkdir()
    (out / "report.json").write_text(json.dumps(report))
    (out / "made.json").write_text('{"wall_s": 3.0}')
    return samples.scored(model.parent, out)


def test_a_right_name_is_told_with_errors_in_floors_of_the_truth(tmp_path, model):
    one = judged(tmp_path, model, [HIDDEN], [TOLD])
    assert samples.names_right(one)
    assert samples.line(one, 0.5) == (
        "right case: hidden armature(elbow); named armature(elbow) 0.80; explained; "
        "4.00 -> 2.00 floors; 3 s"
    )


@pytest.mark.parametrize(
    ("hidden", "named", "right"),
    [([], [], True), ([HIDDEN], [], False), ([], [TOLD], False)],
)
def test_a_clean_robot_is_right_with_no_name_and_only_then(tmp_path, model, hidden, named, right):
    assert samples.names_right(judged(tmp_path, model, hidden, named)) is right


def test_a_second_name_of_nothing_makes_a_case_wrong(tmp_path, model):
    surplus = TOLD | {"joints": ["shoulder"]}
    assert not samples.names_right(judged(tmp_path, model, [HIDDEN], [TOLD, surplus]))


def test_a_case_without_a_report_is_not_right(tmp_path):
    assert samples.told(tmp_path / "case", tmp_path / "out").startswith("WRONG case: no report")


def test_tilted_gravity_of_a_planar_arm_equals_its_first_encoder_offset(model):
    joints, planar = samples.hinges(model)
    assert (joints, planar) == (["shoulder", "elbow"], True)
    tilted = {"effect": "gravity_direction", "joints": []}
    offset = {"effect": "encoder_offset", "joints": ["shoulder"]}
    assert samples.equals(tilted, "shoulder", planar) == [offset]
    assert samples.equals(offset, "shoulder", planar) == [tilted]
    assert samples.equals(offset | {"joints": ["elbow"]}, "shoulder", planar) == []


def test_an_arm_with_an_upright_joint_is_not_planar(model):
    model.write_text(ARM.format(axis="0 0 1"))
    assert samples.hinges(model)[1] is False


def test_a_constant_torque_equals_asymmetric_friction():
    offset = {"effect": "torque_offset", "joints": ["elbow"]}
    same = {"effect": "asymmetric_friction", "joints": ["elbow"]}
    assert samples.equals(offset, "shoulder", False) == [same]
    assert samples.equals(same, "shoulder", False) == [offset]
