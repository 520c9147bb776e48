"""Small LeRobot datasets, written by pyarrow: what tests import."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

FRAMES, FPS = 40, 30
NAMES = ["shoulder_pan.pos", "gripper.pos"]
#: Of two episodes, as the dataset stores them: 32 bit.
STATE = np.random.default_rng(0).normal(size=(2, FRAMES, 2)).astype(np.float32)
ACTION = np.random.default_rng(1).normal(size=(2, FRAMES, 2)).astype(np.float32)


def info(version: str, names: Any = NAMES, size: int = 2) -> dict[str, Any]:
    vector = {"dtype": "float32", "shape": [size], "names": names}
    count = {"dtype": "int64", "shape": [1], "names": None}
    return {
        "codebase_version": version,
        "robot_type": "so101_follower",
        "fps": FPS,
        "total_episodes": 2,
        "features": {
            "action": vector,
            "observation.state": vector,
            "observation.images.front": {"dtype": "video", "shape": [480, 640, 3], "names": None},
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
            "frame_index": count,
            "episode_index": count,
        },
    }


def frames(episodes: list[int], state: Any = STATE, action: Any = ACTION) -> pa.Table:
    rows = np.arange(FRAMES)
    lists = {"action": action, "observation.state": state}
    vectors = {
        name: pa.array(
            [row.tolist() for e in episodes for row in values[e]], pa.list_(pa.float32())
        )
        for name, values in lists.items()
    }
    timestamp = np.tile(rows / FPS, len(episodes)).astype(np.float32)
    counted = {
        "frame_index": pa.array(np.tile(rows, len(episodes))),
        "episode_index": pa.array(np.repeat(episodes, FRAMES)),
    }
    return pa.table(vectors | {"timestamp": pa.array(timestamp)} | counted)


def dataset(root: Path, version: str, **given: Any) -> Path:
    about = info(version, given.pop("names", NAMES), STATE.shape[2])
    (root / "meta").mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(about))
    chunk = root / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    if version.startswith("v2"):
        for e in (0, 1):
            pa.parquet.write_table(frames([e], **given), chunk / f"episode_{e:06d}.parquet")
    else:
        pa.parquet.write_table(frames([0, 1], **given), chunk / "file-000.parquet")
    return root
