"""Effects that a diagnosis wrote come back as they were, and damaged files are refused."""

import json

import pytest

from gfm.core import BadInputError, UnknownNameError
from gfm.experiments.effects_file import read_effects

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


def test_an_unknown_effect_is_refused(tmp_path):
    path = written(tmp_path, {"schema": "gfm.effects/1", "effects": [GOOD | {"effect": "magic"}]})
    with pytest.raises(UnknownNameError, match="magic"):
        read_effects(path)


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ("{", "expected JSON"),
        ({"schema": "other"}, "schema 'other'"),
        ([], "schema None"),
        ({"schema": "gfm.effects/1", "effects": [{"effect": "payload"}]}, "joints"),
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
    with pytest.raises(BadInputError, match=words) as caught:
        read_effects(written(tmp_path, document))
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(BadInputError, match="no such file"):
        read_effects(tmp_path / "nothing.json")
