"""Two processes compare what their environments are made of."""

from __future__ import annotations

import pytest

from gfm.envs.control_settings import ControlSettings
from gfm.envs.registry import EnvironmentSettings
from gfm.service.environment_words import difference, environment_words


def words(**settings):
    return environment_words("gfm_fit", EnvironmentSettings(**settings))


def made(folder, model="<mujoco/>", effects=None, recording="motion"):
    """Returns settings whose files are in a folder."""
    folder.mkdir()
    (folder / "arm.xml").write_text(model)
    (folder / "one.mcap").write_text(recording)
    if effects is not None:
        (folder / "arm.effects.json").write_text(effects)
    return {
        "models": {"velocity": str(folder / "arm.xml")},
        "recordings": (str(folder / "one.mcap"),),
    }


def test_the_same_files_elsewhere_are_the_same_environment(tmp_path):
    here, there = made(tmp_path / "here"), made(tmp_path / "there")
    assert difference(words(**there), words(**here)) == ""


@pytest.mark.parametrize(
    ("other", "setting"),
    [
        ({"model": "<mujoco model='b'/>"}, "models.velocity"),
        ({"effects": "{}"}, "models.velocity"),
        ({"recording": "another"}, "recordings"),
    ],
)
def test_another_content_is_told_by_its_setting_and_both_digests(tmp_path, other, setting):
    ours, theirs = words(**made(tmp_path / "a")), words(**made(tmp_path / "b", **other))
    said = difference(theirs, ours)
    assert said == f"{setting} {theirs[setting]}, not {ours[setting]}"
    assert theirs[setting] != ours[setting]


def test_recordings_in_another_order_are_another_environment(tmp_path):
    paths = [made(tmp_path / name, recording=name)["recordings"][0] for name in "ab"]
    assert words(recordings=tuple(paths)) != words(recordings=tuple(reversed(paths)))


def test_settings_are_compared_and_threads_are_each_machine_s_own():
    assert difference(words(nthread=4), words()) == ""
    assert difference(words(joint_nm=3.0), words()) == "joint_nm 3.0, not 5.0"
    said = difference(words(control=ControlSettings(perturbation=0.5)), words())
    assert said == "control.perturbation 0.5, not 0.0"


def test_a_length_that_is_the_environment_s_own_is_the_same_as_one_that_is_told():
    own = environment_words("point_mass", EnvironmentSettings())
    told = EnvironmentSettings(horizon=int(own["horizon"]))
    assert environment_words("point_mass", told) == own


def test_what_a_stranger_says_is_cut_short():
    said = difference({"x" * 4000: "y" * 4000}, words())
    assert len(max(said.split(", "), key=len)) < 200
    assert "joint_nm absent, not 5.0" in said
