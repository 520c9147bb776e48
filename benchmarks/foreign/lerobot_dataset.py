"""An SO-101 as LeRobot records it: datasets in degrees, without the cameras, of versions 2 and 3.

The episodes are measured motions of a real arm. As in every such dataset a frame's time is its
number by the rate that was asked for (50 Hz): the robot kept 49.8.

Version 2 has a file for each episode, lines of JSON about episodes and tasks, and the names that
its recorder gave the motors (`main_shoulder_pan`); version 3 has all episodes in one file.
"""

from __future__ import annotations

import csv
import gzip
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from foreign.cutting import Sources

FPS = 50
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
_FEATURES = ("observation.state", "action")
_TASK = "Move along a path."
#: States and actions of a motion, each of shape (T, 6): degrees, gripper 0 to 100.
Episode: TypeAlias = tuple[np.ndarray, np.ndarray]


def make(folder: Path, sources: Sources) -> None:
    """Writes so101.xml and so101_motions, a dataset of version 3, into a folder."""
    root = folder / "so101_motions"
    episodes = _measured(folder, sources)
    names = [f"{name}.pos" for name in JOINTS]
    _write_about(root, "v3.0", names, [len(states) for states, _ in episodes])
    _write_table(root / "data/chunk-000/file-000.parquet", dict(enumerate(episodes)))


def make_v2(folder: Path, sources: Sources) -> None:
    """Writes so101.xml and so101_paths, a dataset of version 2.1, into a folder."""
    root = folder / "so101_paths"
    episodes = _measured(folder, sources, last=True)
    count = [len(states) for states, _ in episodes]
    names = [f"main_{name}" for name in JOINTS]
    _write_about(root, "v2.1", names, count)
    for number, one in enumerate(episodes):
        _write_table(root / f"data/chunk-000/episode_{number:06d}.parquet", {number: one})
    _write_lines(root / "meta/tasks.jsonl", [{"task_index": 0, "task": _TASK}])
    lines = [
        {"episode_index": number, "tasks": [_TASK], "length": frames}
        for number, frames in enumerate(count)
    ]
    _write_lines(root / "meta/episodes.jsonl", lines)


def _measured(folder: Path, sources: Sources, *, last: bool = False) -> list[Episode]:
    """Writes the model; returns the first motions at hand, or the last ones."""
    measured = sources.data / "measured" / "so101"
    shutil.copy(measured / "model.xml", folder / "so101.xml")
    found = sorted(measured.glob("*_state_motor.csv.gz"), reverse=last)
    return [episode(path, sources) for path in sources.some(found)]


def episode(path: Path, sources: Sources) -> Episode:
    """Returns states and actions of a motion, each of shape (T, 6): degrees, gripper 0 to 100."""
    told = path.with_name(path.name.replace("state_motor", "control"))
    states, actions = (_lists(sources, one) for one in (path, told))
    count = min(len(states), len(actions))
    to_lerobot = np.array([*[np.degrees(1.0)] * 5, 100.0])
    return states[:count] * to_lerobot, actions[:count] * to_lerobot


def _lists(sources: Sources, path: Path) -> np.ndarray:
    """Returns the column of lists in a table that begins with a word and a time in us."""
    with gzip.open(path, "rt") as file:
        rows = list(csv.DictReader(file))
    kept = [row for row in rows if 1e-6 * float(row["timestamp"]) <= sources.longest_s]
    return np.array([json.loads(row["positions"]) for row in kept])


def _write_about(root: Path, version: str, names: Sequence[str], count: Sequence[int]) -> None:
    """Writes meta/info.json of a dataset whose episodes have `count` frames."""
    vector = {"dtype": "float32", "shape": [len(names)], "names": list(names)}
    number = {"dtype": "int64", "shape": [1], "names": None}
    about = {
        "codebase_version": version,
        "robot_type": "so101_follower",
        "fps": FPS,
        "total_episodes": len(count),
        "total_frames": sum(count),
        "features": {
            **dict.fromkeys(_FEATURES, vector),
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
            "frame_index": number,
            "episode_index": number,
        },
    }
    (root / "meta").mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(about, indent=2))


def _write_lines(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    path.write_text("".join(f"{json.dumps(row)}\n" for row in rows))


def _write_table(path: Path, episodes: dict[int, Episode]) -> None:
    """Writes the frames of some episodes, by their numbers."""
    count = [len(states) for states, _ in episodes.values()]
    frame = np.concatenate([np.arange(frames) for frames in count])
    vectors = {
        feature: pa.array(
            list(np.concatenate([one[i] for one in episodes.values()]).astype(np.float32)),
            pa.list_(pa.float32()),
        )
        for i, feature in enumerate(_FEATURES)
    }
    table = pa.table(
        vectors
        | {
            "timestamp": pa.array((frame / FPS).astype(np.float32)),
            "frame_index": pa.array(frame),
            "episode_index": pa.array(np.repeat([*episodes], count)),
        }
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    pa.parquet.write_table(table, path)
