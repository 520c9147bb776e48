"""An SO-101 as LeRobot records it: a dataset of version 3, in degrees, without the cameras.

The episodes are measured motions of a real arm. As in every such dataset a frame's time is its
number by the rate that was asked for (50 Hz): the robot kept 49.8.
"""

from __future__ import annotations

import csv
import gzip
import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from foreign.cutting import Sources

FPS = 50
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
_FEATURES = ("observation.state", "action")


def make(folder: Path, sources: Sources) -> None:
    """Writes so101.xml and the dataset so101_motions into a folder."""
    measured = sources.data / "measured" / "so101"
    shutil.copy(measured / "model.xml", folder / "so101.xml")
    found = sources.some(sorted(measured.glob("*_state_motor.csv.gz")))
    episodes = [episode(path, sources) for path in found]
    write(folder / "so101_motions", episodes)


def episode(path: Path, sources: Sources) -> tuple[np.ndarray, np.ndarray]:
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


def write(root: Path, episodes: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """Writes a dataset of version 3: all episodes in one file."""
    count = [len(states) for states, _ in episodes]
    vector = {"dtype": "float32", "shape": [6], "names": [f"{name}.pos" for name in JOINTS]}
    number = {"dtype": "int64", "shape": [1], "names": None}
    about = {
        "codebase_version": "v3.0",
        "robot_type": "so101_follower",
        "fps": FPS,
        "total_episodes": len(episodes),
        "total_frames": sum(count),
        "features": {
            **dict.fromkeys(_FEATURES, vector),
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
            "frame_index": number,
            "episode_index": number,
        },
    }
    for name in ("meta", "data/chunk-000"):
        (root / name).mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(about, indent=2))
    frame = np.concatenate([np.arange(frames) for frames in count])
    vectors = {
        feature: pa.array(
            list(np.concatenate([one[i] for one in episodes]).astype(np.float32)),
            pa.list_(pa.float32()),
        )
        for i, feature in enumerate(_FEATURES)
    }
    table = pa.table(
        vectors
        | {
            "timestamp": pa.array((frame / FPS).astype(np.float32)),
            "frame_index": pa.array(frame),
            "episode_index": pa.array(np.repeat(np.arange(len(episodes)), count)),
        }
    )
    pa.parquet.write_table(table, root / "data" / "chunk-000" / "file-000.parquet")
