"""The same cases by another hand: what a simulation and a laboratory would do otherwise.

Same robots, motions, sizes; but integrated explicitly in shorter steps, measured and commanded off
the grid, with stamps that are some tens of microseconds wrong, gears that ripple, and a torque on
every joint that no effect of the vocabulary can say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from known_truth.draft import TRIED, Draft
from known_truth.planted import Planted, discrepancy, ripple
from known_truth.recordings import Sensors
from known_truth.robots import Array
from known_truth.run import STEP_S, Course, Run
from known_truth.simulation import simulate_beside

#: Steps of this hand in one of the other's.
_FINER = 2
_STAMP_NOISE_S = 3e-5
#: Open-loop segments in which the discrepancy is measured, and of how much of each recording, s.
_SEGMENT_S, _MEASURED_S = 0.5, 4.0
#: Torque by which the answer to it is measured, in units of the usual one.
_FIRST = 0.001


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Work:
    """What another hand makes of a case.

    Attributes:
        runs: Its recordings.
        sensors: Of the robot.
        asked: Change of the motion that the discrepancy was to make, in sensor noises.
        changes: What it makes, RMS in open-loop segments, in sensor noises, shape (J,).
        torques: Its RMS over the range of motions, N m, shape (J,).
    """

    runs: list[Run]
    sensors: Sensors
    asked: float
    changes: Array
    torques: Array

    def told(self) -> dict[str, object]:
        """Returns what is written beside the hidden effects."""
        return {
            "hand": "other",
            "discrepancy": {
                "asked": self.asked,
                "changes": self.changes.tolist(),
                "torques": self.torques.tolist(),
                "segment_s": _SEGMENT_S,
            },
        }


def by_another_hand(drafts: Sequence[Draft], asked: float) -> list[Work]:
    """Returns what another hand makes of cases of one build.

    Args:
        drafts: The cases, their sizes found.
        asked: RMS change of the motion in open-loop segments that the discrepancy is to make, over
            all joints, in units of the sensor noise.
    """
    rngs = [np.random.default_rng([one.plan.seed, 5]) for one in drafts]
    runs = [[_finer(run, rng) for run in one.runs] for one, rng in zip(drafts, rngs, strict=True)]
    planted = [discrepancy(one.robot, rng) for one, rng in zip(drafts, rngs, strict=True)]
    factors, changes = _sized(drafts, runs, planted, asked)
    gears = _gears(drafts, runs, rngs)
    made = []
    for i, one in enumerate(drafts):
        whole = planted[i].scaled(factors[i]).beside(gears[i])
        made.append(
            Work(
                runs=[
                    replace(run, hidden=tuple(one.found), planted=whole.in_recording(number))
                    for number, run in enumerate(runs[i])
                ],
                sensors=replace(one.sensors, stamp_noise_s=_STAMP_NOISE_S),
                asked=asked,
                changes=changes[i],
                torques=factors[i] * one.robot.torque,
            )
        )
    return made


def _finer(run: Run, rng: np.random.Generator) -> Run:
    """Returns a run in shorter steps, measured and commanded off the longer ones' grid."""
    off = rng.integers(0, _FINER, len(run.measured_at))
    return replace(
        run,
        first_command_step=_FINER * run.first_command_step + int(rng.integers(0, _FINER)),
        command_every=_FINER * run.command_every,
        measured_at=_FINER * run.measured_at + off,
        step_s=STEP_S / _FINER,
        explicit=True,
    )


def _sized(
    drafts: Sequence[Draft], runs: Sequence[Sequence[Run]], planted: Sequence[Planted], asked: float
) -> tuple[Array, Array]:
    """Returns factors per joint that make the discrepancies what is asked, and what they make.

    Both of shape (B, J). So small torques change the motion in proportion: every joint's is
    corrected once, then, because joints move each other, all of a robot together.
    """
    first = np.full((len(drafts), len(drafts[0].robot.joints)), _FIRST)
    factors = first * asked / _changes(drafts, runs, _scaled(planted, first))
    changes = _changes(drafts, runs, _scaled(planted, factors))
    typical = np.sqrt(np.mean(changes**2, axis=1, keepdims=True))
    share = np.divide(asked, typical, out=np.zeros_like(typical), where=typical > 0.0)
    return share * factors, share * changes


def _gears(
    drafts: Sequence[Draft], runs: Sequence[Sequence[Run]], rngs: Sequence[np.random.Generator]
) -> list[Planted]:
    """Returns the ripple of the robots' gears: where it could be seen well, of better ones."""
    drawn = [ripple(one.robot, rng) for one, rng in zip(drafts, rngs, strict=True)]
    most = np.max(_changes(drafts, runs, drawn), axis=1, keepdims=True)
    joints = len(drafts[0].robot.joints)
    return _scaled(drawn, np.repeat(1.0 / np.maximum(most, 1.0), joints, axis=1))


def _scaled(planted: Sequence[Planted], factors: Array) -> list[Planted]:
    return [one.scaled(factor) for one, factor in zip(planted, factors, strict=True)]


def _changes(
    drafts: Sequence[Draft], runs: Sequence[Sequence[Run]], planted: Sequence[Planted]
) -> Array:
    """Returns RMS changes of the motion in open-loop segments, in sensor noises, shape (B, J).

    Nothing is hidden in the robots, and segments begin at the exact states.
    """
    leaders = [_beginning(run) for each in runs for run in each[:TRIED]]
    others = [
        replace(_beginning(run), planted=one.in_recording(number))
        for each, one in zip(runs, planted, strict=True)
        for number, run in enumerate(each[:TRIED])
    ]
    pairs = simulate_beside(leaders, others, _SEGMENT_S)
    return np.stack(
        [
            _rms(pairs[TRIED * i : TRIED * (i + 1)]) / one.sensors.position_std
            for i, one in enumerate(drafts)
        ]
    )


def _beginning(run: Run) -> Run:
    end = round(_MEASURED_S / run.step_s)
    return replace(run, measured_at=run.measured_at[run.measured_at <= end])


def _rms(pairs: Sequence[tuple[Course, Course]]) -> Array:
    change = np.concatenate([other.position - leader.position for leader, other in pairs])
    return np.asarray(np.sqrt(np.mean(change**2, axis=0)))
