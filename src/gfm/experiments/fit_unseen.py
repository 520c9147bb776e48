"""What policies are compared on while forces are learned: recordings that nothing is fitted to.

A regression follows the recordings that it was made from more closely than any others, and learning
that makes it better on others looks worse on those. So one recording in five is held back from both
(docs/results/unlearning.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from gfm.core import Trajectory
from gfm.envs.pushes import Pushes, errors_under, make_pushes, object_errors
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings
from gfm.experiments.fit_warm import nominal_model
from gfm.experiments.joint_control import ForceModel
from gfm.sim.hybrid import HybridModel
from gfm.sim.rollout import rollout_errors

#: One recording of so many is held back, and one of fewer.
ONE_IN = 5


def held_back(model: HybridModel, recordings: Sequence[Trajectory]) -> list[int]:
    """Returns the numbers of the recordings that are held back, none where there is only one.

    Where the model has an object, only those in which it is pushed from rest say anything.
    """
    telling = list(range(len(recordings)))
    if model.layout.has_object:
        telling = np.unique(make_pushes(model, recordings).recording).tolist()
    if len(telling) < 2:
        return []
    return telling[ONE_IN - 1 :: ONE_IN] or telling[-1:]


def divided(
    settings: EnvironmentSettings, assets: EnvironmentAssets
) -> tuple[EnvironmentSettings, EnvironmentAssets, tuple[Trajectory, ...]]:
    """Returns an environment of the recordings that are fitted, as settings and loaded, and others.

    Those are held back; there may be none.
    """
    out = held_back(nominal_model(settings, assets), assets.trajectories)
    kept = [i for i in range(len(assets.trajectories)) if i not in out]
    recordings, paths = assets.trajectories, settings.recordings
    return (
        msgspec.structs.replace(settings, recordings=tuple(paths[i] for i in kept)),
        replace(assets, trajectories=tuple(recordings[i] for i in kept)),
        tuple(recordings[i] for i in out),
    )


@dataclass(frozen=True, kw_only=True)
class Yardstick:
    """How far simulation is from some recordings.

    Attributes:
        model: What forces are added to.
        recordings: To be followed.
        pushes: Those of an object in them; None where the joints count.
    """

    model: HybridModel
    recordings: Sequence[Trajectory]
    pushes: Pushes | None

    @property
    def unit(self) -> str:
        """Of an error: of an object's place, or of joints."""
        return "rad" if self.pushes is None else "m"

    def error(self, forces: ForceModel | None = None) -> float:
        """Returns the RMSE with some forces or none: of places in pushes, or of joints.

        Joints are followed in open loop through whole recordings.
        """
        policy, features = (forces.policy, forces.features) if forces else (None, None)
        if self.pushes is None:
            errors = rollout_errors(self.model, self.recordings, policy=policy, features=features)
            return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
        if policy is None or features is None:
            return object_errors(self.model, self.pushes).place_m
        return errors_under(policy, features, self.model, self.pushes).place_m


def yardstick(model: HybridModel, recordings: Sequence[Trajectory]) -> Yardstick:
    """Returns how recordings are compared with: by an object's place where one is pushed."""
    pushes = make_pushes(model, recordings) if model.layout.has_object else None
    return Yardstick(model=model, recordings=recordings, pushes=pushes or None)
