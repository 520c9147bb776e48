"""What contact does to the misfit of an arm: segment by segment, with and without its payload.

    python benchmarks/contact.py runs/transfer --payload 0.6

Reads the first attempts of a campaign of `gfm transfer`. Says for every segment what share of it
the robot touches something, and what the nominal cell leaves of it, and the same with the payload
that the robot is known to carry; and for how long the robot touches nothing.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gfm.core import Trajectory
from gfm.diagnosis.data.segmentation import make_problem
from gfm.diagnosis.data.touching import Touch
from gfm.diagnosis.found import SEARCHED_S
from gfm.diagnosis.residuals.initial_states import with_state_basis
from gfm.effects import EffectInstance, find_effect
from gfm.experiments.inputs import load_nominal, read_recordings
from gfm.sim.segment import Segment

#: Shortest time in the air that counts, s.
LEAST_S = 0.3


def touches(touch: Touch, recording: Trajectory) -> np.ndarray:
    """Returns whether the robot touches something at each measurement, shape (T,)."""
    return np.array([touch.at(recording, row) for row in range(len(recording.position))])


def share(recording: Trajectory, touching: np.ndarray, segment: Segment) -> float:
    """Returns the share of a segment in which the robot touches something."""
    begin = int(np.abs(recording.position - segment.position[0]).sum(axis=1).argmin())
    return float(touching[begin : begin + len(segment.position)].mean())


def in_the_air_s(recording: Trajectory, touching: np.ndarray) -> float:
    """Returns for how long the robot touches nothing, in pieces that are long enough, s."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], touching, [True]]).astype(int)))
    pieces = (edges[1::2] - edges[::2]) * recording.period_s
    return float(pieces[pieces > LEAST_S].sum())


def payload(mass: float) -> Sequence[EffectInstance]:
    """Returns a payload of so many kg on the hand's axis."""
    values = {"mass": mass, "com_x": 0.0, "com_y": 0.0, "com_z": 0.1}
    effect = find_effect("payload")
    return (EffectInstance(effect=effect, joints=("right_j6",), values=values),)


def main() -> None:
    """Prints a line per segment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaign", type=Path, metavar="DIR")
    parser.add_argument("--payload", type=float, required=True, metavar="KG")
    asked = parser.parse_args()
    nominal = load_nominal((asked.campaign / "nominal.xml",))
    paths = sorted((asked.campaign / "before" / "recordings").glob("*_0.mcap"))
    recordings = read_recordings(paths)
    touch = Touch(next(iter(nominal.specs.values())), recordings[0].joint_names)
    touching = [touches(touch, one) for one in recordings]
    problem = make_problem(nominal.specs, recordings, most_s=SEARCHED_S)
    left = []
    for effects in ((), payload(asked.payload)):
        residual = with_state_basis(problem, effects).residuals([effects])[0]
        left.append([float(np.mean(residual[rows] ** 2)) for rows in problem.slices()])
    print("touching   nominal   with the payload (squared, in units of the noise)")
    for segment, *both in zip(problem.segments, *left, strict=True):
        at = segment.recording
        print(f"{share(recordings[at], touching[at], segment):8.2f} {both[0]:9.0f} {both[1]:9.0f}")
    air_s = sum(map(in_the_air_s, recordings, touching))
    print(f"in the air for {air_s:.1f} s of {sum(one.duration_s for one in recordings):.1f} s")


if __name__ == "__main__":
    main()
