"""Every episode of a LeRobot dataset becomes a recording, number for number."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from gfm.core import RecordingError
from gfm.importing import imported
from gfm.importing.mapping import Mapping, load_mapping
from made_datasets import ACTION, FPS, FRAMES, NAMES, STATE, dataset, info


def mapping(
    tmp_path: Path, elements: tuple[str, str] = ("shoulder_pan.pos", "gripper.pos")
) -> Mapping:
    joints = "".join(
        f"""
[[joints]]
name = "{name}"
position = "observation.state.{element}"
command = {{ column = "action.{element}", scale = 0.5, offset = 1.0 }}
"""
        for name, element in zip(["shoulder_pan", "gripper"], elements, strict=True)
    )
    head = 'format = "lerobot"\ntime = "timestamp"\ncommand_kind = "position"\n'
    (tmp_path / "map.toml").write_text(head + joints)
    return load_mapping(tmp_path / "map.toml")


@pytest.mark.parametrize("version", ["v2.0", "v2.1", "v3.0"])
def test_episodes_become_recordings(tmp_path: Path, version: str) -> None:
    path = dataset(tmp_path / "pick", version)
    runs = list(imported([path], mapping(tmp_path)))
    assert [run.name for run in runs] == ["pick_episode_000", "pick_episode_001"]
    for run, state, action in zip(runs, STATE, ACTION, strict=True):
        assert run.joint_names == ("shoulder_pan", "gripper")
        np.testing.assert_array_equal(run.position, state)
        np.testing.assert_array_equal(run.command, 0.5 * action.astype(float) + 1.0)
        np.testing.assert_allclose(run.time_s, np.arange(FRAMES) / FPS, atol=2e-7)
        assert run.metadata["robot_type"] == "so101_follower"


@pytest.mark.parametrize("names", [{"motors": NAMES}, NAMES, {n: i for i, n in enumerate(NAMES)}])
def test_names_may_be_grouped(tmp_path: Path, names: Any) -> None:
    path = dataset(tmp_path / "pick", "v2.1", names=names)
    assert len(list(imported([path], mapping(tmp_path)))) == 2


@pytest.mark.parametrize("names", [None, ["motors"]])
def test_elements_without_names_are_counted(tmp_path: Path, names: Any) -> None:
    path = dataset(tmp_path / "pick", "v3.0", names=names)
    first, _ = imported([path], mapping(tmp_path, ("0", "1")))
    np.testing.assert_array_equal(first.position, STATE[0])


def refusal(path: Path, told: Mapping) -> str:
    with pytest.raises(RecordingError) as refused:
        list(imported([path], told))
    assert "\n" not in str(refused.value)
    assert str(path) in str(refused.value)
    return str(refused.value)


def test_a_dataset_without_actions_is_refused(tmp_path: Path) -> None:
    path = dataset(tmp_path / "pick", "v3.0")
    about = info("v3.0")
    del about["features"]["action"]
    (path / "meta" / "info.json").write_text(json.dumps(about))
    assert "feature action: is missing" in refusal(path, mapping(tmp_path))


def test_a_parquet_file_cut_in_half_is_refused(tmp_path: Path) -> None:
    path = dataset(tmp_path / "pick", "v2.1")
    file = path / "data" / "chunk-000" / "episode_000001.parquet"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    words = refusal(path, mapping(tmp_path))
    assert "episode_000001.parquet: cannot be read (" in words


def test_frames_other_than_described_are_refused(tmp_path: Path) -> None:
    path = dataset(tmp_path / "pick", "v2.1")
    about = info("v2.1", size=3)
    (path / "meta" / "info.json").write_text(json.dumps(about))
    assert "as meta/info.json says" in refusal(path, mapping(tmp_path))


def test_an_unknown_joint_is_refused_with_those_that_are_there(tmp_path: Path) -> None:
    path = dataset(tmp_path / "pick", "v3.0")
    words = refusal(path, mapping(tmp_path, ("elbow.pos", "gripper.pos")))
    assert "column observation.state.elbow.pos: is missing" in words
    assert "observation.state.shoulder_pan.pos" in words


def test_bad_numbers_and_clocks_are_refused(tmp_path: Path) -> None:
    state = STATE.copy()
    state[1, 4, 0] = np.nan
    words = refusal(dataset(tmp_path / "nan", "v3.0", state=state), mapping(tmp_path))
    assert "episode 1: column observation.state.shoulder_pan.pos: row 5: is nan" in words
    path = dataset(tmp_path / "back", "v3.0")
    file = path / "data" / "chunk-000" / "file-000.parquet"
    table = pa.parquet.read_table(file)
    pa.parquet.write_table(table.take(pa.array(np.arange(2 * FRAMES)[::-1])), file)
    assert "column timestamp: row 2 is" in refusal(path, mapping(tmp_path))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "meta/info.json: cannot be read (.*); expected a LeRobot dataset"),
        ("{", "cannot be read"),
        ("{}", "cannot be read"),
        (json.dumps(info("v1.6")), "codebase_version is v1.6; expected v2.0, v2.1 or v3.0"),
        (json.dumps(info("v3.0")), "data: has no .parquet file"),
    ],
)
def test_what_is_no_dataset_is_refused(tmp_path: Path, content: str | None, words: str) -> None:
    (tmp_path / "pick" / "meta").mkdir(parents=True)
    if content is not None:
        (tmp_path / "pick" / "meta" / "info.json").write_text(content)
    with pytest.raises(RecordingError, match=words.replace("(.*)", r"\(.*\)")):
        list(imported([tmp_path / "pick"], mapping(tmp_path)))
