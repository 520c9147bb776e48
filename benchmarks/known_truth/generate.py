"""Finds the sizes of effects, simulates cases, and writes what a user would have: files.

A size is drawn for each effect, then made stronger or weaker until it changes the motion by enough
to be found (at least five times the sensor noise) and not by so much that nothing else is seen.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from known_truth.draft import Draft, draft
from known_truth.mjcf import mjcf
from known_truth.plans import Plan
from known_truth.recordings import write_recording
from known_truth.run import STEP_S, Course, Run
from known_truth.simulation import simulate
from known_truth.truth import truth

#: Robots simulated side by side.
_BATCH = 320
#: Recordings on which sizes are tried, and how much of each, s.
_TRIED, _TRIED_S = 2, 5.0


def generate(plans: Sequence[Plan], folder: Path) -> None:
    """Writes the cases that are not there yet: `cases/NAME`, and what they hide, `truth/NAME.json`.

    What is judged is told of the first alone.
    """
    missing = [plan for plan in plans if not (folder / "truth" / f"{plan.name}.json").exists()]
    builds = dict.fromkeys(plan.setup.robot.joints for plan in missing)
    for build in builds:
        drafts = [draft(plan) for plan in missing if plan.setup.robot.joints == build]
        for some in _portions(drafts):
            _find_sizes(some)
            _write_all(some, folder)


def _portions(drafts: Sequence[Draft]) -> Iterator[list[Draft]]:
    """Yields drafts that can be simulated side by side."""
    portion: list[Draft] = []
    for one in drafts:
        if portion and sum(len(d.runs) for d in portion) + len(one.runs) > _BATCH:
            yield portion
            portion = []
        portion.append(one)
    if portion:
        yield portion


def _find_sizes(drafts: Sequence[Draft]) -> None:
    """Finds sizes for all effects of all drafts, in rounds."""
    tried = [one for one in drafts if one.plan.effects]
    courses = simulate([run for one in tried for run in _beginnings(one)]) if tried else []
    for i, one in enumerate(tried):
        one.nominal = courses[_TRIED * i : _TRIED * (i + 1)]
    while open_ := [one for one in tried if not one.complete]:
        candidates = [one.candidate() for one in open_]
        runs = [
            replace(run, hidden=(candidate,))
            for one, candidate in zip(open_, candidates, strict=True)
            for run in _beginnings(one)
        ]
        courses = simulate(runs)
        for i, (one, candidate) in enumerate(zip(open_, candidates, strict=True)):
            one.judge(candidate, _signal(one, courses[_TRIED * i : _TRIED * (i + 1)]))


def _beginnings(one: Draft) -> list[Run]:
    """Returns the beginnings of the recordings on which sizes are tried."""
    end = round(_TRIED_S / STEP_S)
    return [replace(r, measured_at=r.measured_at[r.measured_at <= end]) for r in one.runs[:_TRIED]]


def _signal(one: Draft, courses: Sequence[Course]) -> float:
    """Returns the RMS change of the joint that changes most, in units of the sensor noise."""
    change = np.concatenate(
        [a.position - b.position for a, b in zip(courses, one.nominal, strict=True)]
    )
    return float(np.sqrt(np.mean(change**2, axis=0)).max() / one.sensors.position_std)


def _write_all(drafts: Sequence[Draft], folder: Path) -> None:
    runs = [replace(run, hidden=tuple(one.found)) for one in drafts for run in one.runs]
    courses = iter(zip(runs, simulate(runs), strict=True))
    for one in drafts:
        place = folder / "cases" / one.plan.name
        rng = np.random.default_rng([one.plan.seed, 2])
        for name in one.names:
            run, course = next(courses)
            write_recording(place / f"{name}.mcap", run, course, one.sensors, rng)
        for kind in one.plan.setup.kinds:
            (place / f"model_{kind}.xml").write_text(mjcf(one.robot, kind))
        hidden = folder / "truth" / f"{one.plan.name}.json"
        hidden.parent.mkdir(exist_ok=True)
        hidden.write_text(json.dumps(truth(one), indent=1) + "\n")
