"""Effects that a diagnosis wrote come back as they were, and damaged files are refused."""

import json

import pytest

from gfm.core import BadInputError
from gfm.service.effects_file import read_effects

GOOD = {
    "effect": "stribeck_friction",
    "joints": ["elbow"],
    "parameters": {
        "static_excess": {"value": 0.5, "unit": "N m", "ci95": None},
        "stribeck_velocity": {"value": 0.05, "unit": "rad/s", "ci95": [0.04, 0.06]},
    },
}


def written(tmp_path, document):
    path = tmp_path / "corrected.effects.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


@pytest.mark.parametrize("schema", ["gfm.effects/1", "gfm.diagnosis/1"])
def test_effects_come_back_with_place_and_amounts(tmp_path, schema):
    (found,) = read_effects(written(tmp_path, {"schema": schema, "effects": [GOOD]}))
    assert found.key == ("stribeck_friction", ("elbow",))
    assert found.values == {"static_excess": 0.5, "stribeck_velocity": 0.05}


def test_what_takes_off_what_a_model_has_may_be_less_than_nothing(tmp_path):
    less = {"effect": "armature", "joints": ["elbow"], "parameters": {"inertia": {"value": -0.02}}}
    (found,) = read_effects(written(tmp_path, {"schema": "gfm.diagnosis/1", "effects": [less]}))
    assert found.values == {"inertia": -0.02}
    assert found.takes_off


def test_of_a_native_effect_the_model_beside_it_has_its_part_and_that_of_a_report_has_not(tmp_path):
    offset = {"effect": "encoder_offset", "joints": ["elbow"], "native": True}
    offset["parameters"] = {"offset": {"value": 0.1}}
    document = {"effects": [offset, GOOD]}
    beside = read_effects(written(tmp_path, document | {"schema": "gfm.effects/1"}))
    assert [one.in_model for one in beside] == [True, False]
    reported = read_effects(written(tmp_path, document | {"schema": "gfm.diagnosis/1"}))
    assert [one.in_model for one in reported] == [False, False]


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ("{", "expected JSON"),
        ({"schema": "other"}, "schema 'other'"),
        ([], "schema None"),
        ({"schema": "gfm.effects/1"}, "effects None, expected a list"),
        ({"schema": "gfm.effects/1", "effects": [GOOD | {"effect": "magic"}]}, "effect 'magic'"),
        ({"schema": "gfm.effects/1", "effects": [{"effect": "payload"}]}, "joints"),
        ({"schema": "gfm.effects/1", "effects": ["payload"]}, "expected effect, joints"),
        (
            {"schema": "gfm.effects/1", "effects": [GOOD | {"joints": []}]},
            "on no joint; expected 1",
        ),
        (
            {"schema": "gfm.effects/1", "effects": [GOOD | {"parameters": {}}]},
            "expected static_excess, stribeck_velocity",
        ),
        (
            {
                "schema": "gfm.effects/1",
                "effects": [
                    GOOD
                    | {
                        "parameters": {
                            "static_excess": {"value": -1.0},
                            "stribeck_velocity": {"value": 0.05},
                        }
                    }
                ],
            },
            "out of bounds",
        ),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(tmp_path, document, words):
    path = written(tmp_path, document)
    with pytest.raises(BadInputError, match=words) as caught:
        read_effects(path)
    assert str(caught.value).startswith(f"effects {path}: ")
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(BadInputError, match="no such file"):
        read_effects(tmp_path / "nothing.json")
