"""What contact does to the misfit of an arm: segment by segment, with and without its payload.

    python benchmarks/contact.py runs/transfer --payload 0.6

Reads the first attempts of a campaign of `gfm transfer`. Says for every segment, first of those in
which the robot touches nothing, then of those in which it touches something, what the nominal cell
leaves of it, and the same with the payload that the robot is known to carry.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gfm.api.models import load_nominal
from gfm.api.recordings import read_recordings
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.residuals.initial_states import with_state_basis
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance, find_effect


def payload(mass: float) -> Sequence[EffectInstance]:
    """Returns a payload of so many kg on the hand's axis."""
    values = {"mass": mass, "com_x": 0.0, "com_y": 0.0, "com_z": 0.1}
    effect = find_effect("payload")
    return (EffectInstance(effect=effect, joints=("right_j6",), values=values),)


def both_left(problem: Problem, mass: float) -> list[list[float]]:
    """Returns the mean squared residual of every segment, without a payload and with one."""
    left = []
    for effects in ((), payload(mass)):
        residual = with_state_basis(problem, effects).residuals([effects])[0]
        left.append([float(np.mean(residual[rows] ** 2)) for rows in problem.slices()])
    return left


def main() -> None:
    """Prints a line per segment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaign", type=Path, metavar="DIR")
    parser.add_argument("--payload", type=float, required=True, metavar="KG")
    asked = parser.parse_args()
    nominal = load_nominal((asked.campaign / "nominal.xml",))
    paths = sorted((asked.campaign / "before" / "recordings").glob("*_0.mcap"))
    recordings = read_recordings(paths)
    whole_s = sum(one.duration_s for one in recordings)
    for touching, where in ((False, "in the air"), (True, "touching something")):
        problem = all_segments(nominal.specs, recordings, touching=touching)
        told_s = sum(float(segment.time_s[-1]) for segment in problem.segments)
        print(f"{where}: {len(problem.segments)} segments, {told_s:.1f} s of {whole_s:.1f} s")
        print("  length   nominal   with the payload (squared, in units of the noise)")
        problem = prepared(problem)
        for segment, *left in zip(
            problem.segments, *both_left(problem, asked.payload), strict=True
        ):
            print(f"{segment.time_s[-1]:6.2f} s {left[0]:9.0f} {left[1]:9.0f}")


if __name__ == "__main__":
    main()
