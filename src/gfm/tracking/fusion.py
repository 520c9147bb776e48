"""One pose from up to a few cameras: weighted by their covariances, without those that disagree.

Every camera tells a few poses, each of which may be right. Each is tried as the truth: whoever has
no pose near it pays a fixed price, and the cheapest truth wins. What was expected beforehand has a
voice like a camera's, but no weight in the mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gfm.core.checks import Array
from gfm.tracking.rigid import Pose, apart, moved
from gfm.tracking.sighting import Candidate, chi_square_limit

#: Squared Mahalanobis distance from which two poses disagree: one in 100,000 of those that do not.
DISAGREES = chi_square_limit(6, 1e-5)
#: How much cheaper than its rivals a truth must be to be believed: a likelihood ratio of 100.
_MARGIN = 2.0 * np.log(100.0)
_ITERATIONS = 3


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """What one camera tells.

    Attributes:
        camera: Its name.
        candidates: What explains its image, the best first; at least one.
    """

    camera: str
    candidates: tuple[Candidate, ...]


@dataclass(frozen=True, kw_only=True)
class Expected:
    """A pose that was expected, and how well: covariance of its error, shape (6, 6)."""

    pose: Pose
    covariance: Array


@dataclass(frozen=True, kw_only=True)
class Fused:
    """The pose that the cameras agree on.

    Attributes:
        pose: In the base frame.
        covariance: Of its error, shape (6, 6).
        tags: How many tags speak for it, counted by every camera.
        used: The cameras that it was made of.
        rejected: Those that disagree with it.
        views: What each of them says alone: of what it leaves open, what agrees best.
        was_expected: Whether it agrees with what was expected.
    """

    pose: Pose
    covariance: Array
    tags: int
    used: tuple[str, ...]
    rejected: tuple[str, ...]
    views: Mapping[str, Candidate]
    was_expected: bool


def distance(one: Candidate | Expected | Fused, other: Candidate | Expected | Fused) -> float:
    """Returns the squared Mahalanobis distance between two poses."""
    error = apart(one.pose, other.pose)
    return float(error @ np.linalg.solve(one.covariance + other.covariance, error))


@dataclass(frozen=True, kw_only=True)
class _Truth:
    """What it costs to take one candidate for the truth, and who agrees with it."""

    candidate: Candidate
    cost: float
    agreeing: dict[str, Candidate]
    was_expected: bool


def fuse(estimates: Sequence[Estimate], expected: Expected | None = None) -> Fused | None:
    """Returns the pose that cameras agree on; None without cameras, or where they leave it open."""
    truths = [
        _tried(candidate, estimates, expected) for e in estimates for candidate in e.candidates
    ]
    if not truths:
        return None
    best = min(truths, key=lambda truth: truth.cost)
    pose, covariance = weighted_mean(tuple(best.agreeing.values()))
    fused = Fused(
        pose=pose,
        covariance=covariance,
        tags=sum(one.tags for one in best.agreeing.values()),
        used=tuple(best.agreeing),
        rejected=tuple(e.camera for e in estimates if e.camera not in best.agreeing),
        views={e.camera: best.agreeing.get(e.camera, e.candidates[0]) for e in estimates},
        was_expected=best.was_expected,
    )
    rivals = (t for t in truths if t.cost < best.cost + _MARGIN)
    if any(distance(rival.candidate, best.candidate) > DISAGREES for rival in rivals):
        return None
    return fused


def _tried(truth: Candidate, estimates: Sequence[Estimate], expected: Expected | None) -> _Truth:
    cost, agreeing = 0.0, {}
    for estimate in estimates:
        least = estimate.candidates[0].cost
        prices = [
            (0.0 if one is truth else distance(one, truth)) + one.cost - least
            for one in estimate.candidates
        ]
        price = min(prices)
        cost += min(price, DISAGREES)
        if price < DISAGREES:
            agreeing[estimate.camera] = estimate.candidates[prices.index(price)]
    surprise = 0.0 if expected is None else distance(truth, expected)
    return _Truth(
        candidate=truth,
        cost=cost + min(surprise, DISAGREES),
        agreeing=agreeing,
        was_expected=expected is not None and surprise < DISAGREES,
    )


def weighted_mean(poses: Sequence[Candidate]) -> tuple[Pose, Array]:
    """Returns the pose whose errors to all of them weigh nothing together, and its covariance."""
    weights = [np.linalg.inv(one.covariance) for one in poses]
    covariance = np.linalg.inv(np.sum(weights, axis=0))
    mean = poses[0].pose
    for _ in range(_ITERATIONS if len(poses) > 1 else 0):
        pull = sum(w @ apart(p.pose, mean) for w, p in zip(weights, poses, strict=True))
        mean = moved(mean, covariance @ pull)
    return mean, covariance
