"""The pose of an object from the tags that one camera sees.

Every tag by itself gives two poses: a flat square seen from afar looks much the same when it is
tilted the other way. They are hypotheses for the whole object. The best are refined on all corners
that agree with them; where several explain the image about as well, all of them are told.

Shape letters: n tags, h hypotheses.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv

from gfm.core.checks import Array
from gfm.tracking.camera import Camera
from gfm.tracking.detect import Detection
from gfm.tracking.layout import CORNERS, TagLayout
from gfm.tracking.rigid import Pose, cross_matrix, turn_by, turn_of

#: How far a corner may be off, in standard deviations, in one round of refining after the other:
#: a single tag's pose is rough, and places its neighbours badly.
_ROUNDS = (30.0, 10.0, 4.5)
#: A tag with fewer corners in place is no such tag.
_LEAST_CORNERS = 3
#: Share of good sightings that may be taken for bad ones.
_RISK = 1e-6
#: A pose that is turned less than this from another one is the same solution, rad.
_SAME_TURN = np.radians(5.0)
#: Another solution is told where twice its log-likelihood falls short by no more.
_UNLIKELY = 25.0
_MOST = 3


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One pose that explains what a camera saw.

    Attributes:
        pose: Of the object, in the base frame.
        covariance: Of its error, the camera's own spread included, shape (6, 6).
        cost: Twice the negative log-likelihood, wrong corners counted as far as they are told.
        tags: How many tags speak for it.
    """

    pose: Pose
    covariance: Array
    cost: float
    tags: int


def chi_square_limit(freedom: int, risk: float) -> float:
    """Returns what a chi-square variable exceeds with a probability `risk`."""
    return float(2.0 * gammainccinv(0.5 * freedom, risk))


def candidates(camera: Camera, layout: TagLayout, seen: Detection) -> tuple[Candidate, ...]:
    """Returns the poses that explain what a camera saw, the best first; at most three.

    Tags that the object does not have, and numbers that are seen twice, are left out. Distortion is
    taken off the corners first; their noise is taken to stay as it was.
    """
    view = _view(camera, layout, seen)
    if view is None:
        return ()
    guesses = sorted(view.guesses(), key=lambda guess: view.cost(guess[1]))
    fits: list[_Fit] = []
    for number, guess in guesses:
        if len(fits) < _MOST and not any(fit.explains(number, guess) for fit in fits):
            fit = view.refined(guess)
            if fit is not None and not any(fit.is_like(other) for other in fits):
                fits.append(fit)
    fits.sort(key=lambda fit: fit.cost)
    likely = [fit for fit in fits if fit.cost <= fits[0].cost + _UNLIKELY]
    return tuple(_candidate(camera, fit) for fit in likely)


def _turned(one: Pose, other: Pose) -> bool:
    return bool(np.linalg.norm(turn_of(one.rotation.T @ other.rotation)) > _SAME_TURN)


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """A pose of the object in the camera's frame, refined.

    Attributes:
        pose: The object, seen from the camera.
        covariance: Of its error along and about the camera's axes, shape (6, 6).
        cost: As in Candidate.
        agreeing: Which tags speak for it, shape (n,).
    """

    pose: Pose
    covariance: Array
    cost: float
    agreeing: NDArray[np.bool_]

    def explains(self, tag: int, guess: Pose) -> bool:
        """Whether a guess by one of the tags leads to nothing new."""
        return bool(self.agreeing[tag]) and not _turned(guess, self.pose)

    def is_like(self, other: _Fit) -> bool:
        """Whether another fit says the same."""
        is_same = np.array_equal(self.agreeing, other.agreeing)
        return is_same and not _turned(self.pose, other.pose)


@dataclass(frozen=True, kw_only=True)
class _View:
    """What a camera saw of an object.

    Attributes:
        points: Corners on the object, m, shape (n, 4, 3).
        pixels: The same in the image, without distortion, shape (n, 4, 2).
        tag_poses: Each tag on the object.
        sizes: Sides of the tags, m.
        matrix: The camera's, shape (3, 3).
        noise_px: Standard deviation of each coordinate of a corner.
    """

    points: Array
    pixels: Array
    tag_poses: tuple[Pose, ...]
    sizes: tuple[float, ...]
    matrix: Array
    noise_px: float

    def guesses(self) -> Iterator[tuple[int, Pose]]:
        """Yields the object as seen from the camera by each tag alone, with the tag's place."""
        flag = cv2.SOLVEPNP_IPPE_SQUARE
        tags = zip(self.pixels, self.tag_poses, self.sizes, strict=True)
        for number, (pixels, tag, size_m) in enumerate(tags):
            _, turns, places, _ = cv2.solvePnPGeneric(
                size_m * CORNERS, pixels, self.matrix, None, flags=flag
            )
            for turn, place in zip(turns, places, strict=True):
                if np.isfinite(turn).all() and np.isfinite(place).all():
                    seen = Pose(rotation=turn_by(turn.ravel()), position=place.ravel())
                    yield number, seen @ tag.inverse

    def errors(self, pose: Pose) -> Array:
        """Returns how far corners are off, in standard deviations, shape (n, 4, 2)."""
        seen = pose.of(self.points)
        ahead = np.maximum(seen[..., 2:], 1e-3)
        focal, centre = np.diag(self.matrix)[:2], self.matrix[:2, 2]
        told = focal * seen[..., :2] / ahead + centre
        return np.asarray((told - self.pixels) / self.noise_px)

    def cost(self, pose: Pose) -> float:
        """Returns the sum of squared errors, each tag's no more than `_UNLIKELY`."""
        each = np.sum(self.errors(pose) ** 2, axis=(1, 2))
        return float(np.minimum(each, _UNLIKELY).sum())

    def agreeing(self, pose: Pose, limit: float) -> NDArray[np.bool_]:
        """Returns which corners are where they should be, shape (n, 4)."""
        near = np.linalg.norm(self.errors(pose), axis=2) < limit
        return np.asarray(near & (near.sum(axis=1) >= _LEAST_CORNERS)[:, None])

    def refined(self, pose: Pose) -> _Fit | None:
        """Returns the best pose near one; None where too little agrees with it."""
        for limit in _ROUNDS:
            good = self.agreeing(pose, limit)
            if not good.any():
                return None
            turn, place = cv2.solvePnPRefineLM(
                self.points[good],
                self.pixels[good],
                self.matrix,
                None,
                turn_of(pose.rotation).reshape(3, 1),
                pose.position.reshape(3, 1).copy(),
            )
            pose = Pose(rotation=turn_by(turn.ravel()), position=place.ravel())
        return self._judged(pose)

    def _judged(self, pose: Pose) -> _Fit | None:
        good = self.agreeing(pose, _ROUNDS[-1])
        corners = int(good.sum())
        errors = self.errors(pose)[good]
        freedom = 2 * corners - 6
        if freedom <= 0 or np.sum(errors**2) > chi_square_limit(freedom, _RISK):
            return None
        return _Fit(
            pose=pose,
            covariance=np.asarray(np.linalg.inv(self._information(pose, good))),
            cost=self.cost(pose),
            agreeing=np.asarray(good.any(axis=1)),
        )

    def _information(self, pose: Pose, good: NDArray[np.bool_]) -> Array:
        """Returns what the corners tell of the pose's error, camera axes, shape (6, 6)."""
        arms = self.points[good] @ pose.rotation.T
        seen = arms + pose.position
        slopes = np.zeros((len(seen), 2, 3))
        for axis in range(2):
            focal = self.matrix[axis, axis]
            slopes[:, axis, axis] = focal / seen[:, 2]
            slopes[:, axis, 2] = -focal * seen[:, axis] / seen[:, 2] ** 2
        turns = -np.stack([cross_matrix(arm) for arm in arms])
        rows = np.concatenate([slopes, slopes @ turns], axis=2).reshape(-1, 6) / self.noise_px
        return np.asarray(rows.T @ rows)


def _view(camera: Camera, layout: TagLayout, seen: Detection) -> _View | None:
    """Returns the known part of what was seen; None where there is none."""
    counts = Counter(seen.ids)
    known = [i for i, number in enumerate(seen.ids) if counts[number] == 1]
    known = [i for i in known if seen.ids[i] in layout.corners]
    if not known:
        return None
    tags = {tag.id: tag for tag in layout.tags}
    shown = [tags[seen.ids[i]] for i in known]
    return _View(
        points=np.stack([layout.corners[tag.id] for tag in shown]),
        pixels=camera.straightened(seen.corners[known]),
        tag_poses=tuple(tag.pose for tag in shown),
        sizes=tuple(tag.size_m for tag in shown),
        matrix=camera.matrix,
        noise_px=camera.corner_noise_px,
    )


def _candidate(camera: Camera, fit: _Fit) -> Candidate:
    """Returns a fit in the base frame, with what the camera's own spread adds."""
    pose = camera.pose @ fit.pose
    axes = np.kron(np.eye(2), camera.pose.rotation)
    return Candidate(
        pose=pose,
        covariance=axes @ fit.covariance @ axes.T + camera.spread_at(pose.position),
        cost=fit.cost,
        tags=int(fit.agreeing.sum()),
    )
