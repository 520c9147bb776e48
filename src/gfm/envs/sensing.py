"""What a robot's sensors tell of simulations: joints with noise, the object as cameras see it.

Cameras look at their own rate, a look is known later, and some looks find nothing. What a policy
then sees is the newest pose that is known.

Shape letters: N instances, n of them, J joints.
"""

from __future__ import annotations

import math
from typing import Annotated, final

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from gfm.core.checks import Array

NotNegative = Annotated[float, Meta(ge=0.0)]


class Sensing(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How well a robot measures itself and the object.

    Attributes:
        joint_noise_rad: Standard deviation of measured positions.
        speed_noise_rad_s: Of measured velocities.
        look_s: Between two looks of the cameras.
        late_s: From a look until its pose is known.
        place_noise_m: Standard deviation of each coordinate of a pose.
        turn_noise_rad: Of the rotation about each axis.
        lost: Share of the looks in which the object is not found.
    """

    joint_noise_rad: NotNegative = 1e-4
    speed_noise_rad_s: NotNegative = 2e-3
    look_s: Annotated[float, Meta(gt=0.0)] = 1.0 / 30.0
    late_s: NotNegative = 0.05
    place_noise_m: NotNegative = 1e-3
    turn_noise_rad: NotNegative = 1e-2
    lost: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.02


@final
class Sensors:
    """The sensors of N instances.

    Args:
        sensing: How well they measure.
        num_envs: N.
        period_s: Between two measurements of the joints.
        rng: Of noise and of what is lost.
    """

    def __init__(
        self, sensing: Sensing, num_envs: int, period_s: float, rng: np.random.Generator
    ) -> None:
        self._sensing, self._period_s, self._rng = sensing, period_s, rng
        kept = 2 + math.ceil((sensing.late_s + sensing.look_s) / period_s)
        self._poses = np.zeros((kept, num_envs, 7))  # newest first
        self._known = np.zeros((num_envs, 7))
        self._next_look_s = np.zeros(num_envs)  # from now on; it was in the past if negative

    @property
    def object_pose(self) -> Array:
        """The object as it is known now: m and quaternion w x y z, shape (N, 7)."""
        return self._known.copy()

    def joints(self, position: Array, velocity: Array) -> tuple[Array, Array]:
        """Returns joints as measured: rad and rad/s, shape (N, J) each."""
        noise = self._rng.standard_normal((2, *position.shape))
        sensing = self._sensing
        return (
            position + sensing.joint_noise_rad * noise[0],
            velocity + sensing.speed_noise_rad_s * noise[1],
        )

    def begin(self, ids: NDArray[np.intp], pose: Array) -> None:
        """Lets the objects of the instances `ids` have lain where they are, (N, 7)."""
        self._poses[:, ids] = pose[ids]
        self._known[ids] = self._noisy(pose[ids])
        ahead = self._rng.uniform(0.0, self._sensing.look_s, len(ids))
        self._next_look_s[ids] = ahead - self._sensing.late_s

    def see(self, pose: Array) -> None:
        """Takes in where the objects are a period later, shape (N, 7)."""
        sensing = self._sensing
        self._poses = np.concatenate([pose[None], self._poses[:-1]])
        self._next_look_s -= self._period_s
        looks = np.floor((-sensing.late_s - self._next_look_s) / sensing.look_s) + 1.0
        looks = np.maximum(looks, 0.0)
        self._next_look_s += looks * sensing.look_s
        found = (looks > 0.0) & (self._rng.random(len(looks)) >= sensing.lost)
        ago_s = sensing.look_s - self._next_look_s[found]
        self._known[found] = self._noisy(self._at(found, ago_s))

    def _at(self, chosen: NDArray[np.bool_], ago_s: Array) -> Array:
        """Returns where the objects of n instances were some time ago, shape (n, 7)."""
        steps = ago_s / self._period_s
        after = steps.astype(int)
        share = (steps - after)[:, None]
        ids = np.flatnonzero(chosen)
        newer, older = self._poses[after, ids], self._poses[after + 1, ids]
        return np.asarray(newer + share * (older - newer))

    def _noisy(self, pose: Array) -> Array:
        """Returns poses with noise, shape (n, 7)."""
        noise = self._rng.standard_normal((len(pose), 6))
        told = pose.copy()
        told[:, :3] += self._sensing.place_noise_m * noise[:, :3]
        w, v = pose[:, 3:4], pose[:, 4:]
        turn = 0.5 * self._sensing.turn_noise_rad * noise[:, 3:]
        told[:, 3:4] -= np.sum(v * turn, axis=1, keepdims=True)
        told[:, 4:] += w * turn + np.cross(v, turn)
        told[:, 3:] /= np.linalg.norm(told[:, 3:], axis=1, keepdims=True)
        return told
