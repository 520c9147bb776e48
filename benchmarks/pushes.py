"""How far an object is from where it was recorded, by several models of the robot and its cell.

    python benchmarks/pushes.py runs/drive/recordings/*.mcap --model nominal.xml corrected.xml

A line per model. Each push is rolled out from where the object rests, the robot moving as it was
measured.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from gfm.api.models import load_nominal
from gfm.api.recordings import read_recordings
from gfm.envs.arm import CONTROL_PERIOD_S
from gfm.envs.pushes import make_pushes, object_errors
from gfm.sim.hybrid import HybridModel


def main() -> None:
    """Prints a line per model."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", type=Path, nargs="+", metavar="RECORDING")
    parser.add_argument("--model", type=Path, nargs="+", required=True, metavar="FILE")
    asked = parser.parse_args()
    recordings = read_recordings(asked.recordings)
    for path in asked.model:
        robot = load_nominal((path,))
        model = HybridModel(
            models={kind: spec.copy().compile() for kind, spec in robot.specs.items()},
            joint_names=recordings[0].joint_names,
            control_period_s=CONTROL_PERIOD_S,
            effects=robot.effects,
        )
        found = object_errors(model, make_pushes(model, recordings))
        place_mm, yaw_deg = 1e3 * found.place_m, math.degrees(found.yaw_rad)
        print(f"{path}: {found.pushes} pushes, {place_mm:.1f} mm, {yaw_deg:.1f} degrees")


if __name__ == "__main__":
    main()
