"""How well fitted forces predict recordings that were held out.

An arm is followed through whole recordings. Where it pushes an object, this is followed from where
it rests, with the arm where it was measured: what forces on the object are worth shows there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from typing_extensions import override

from gfm.api.models import NominalModel
from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.segmentation import measure_noise
from gfm.envs.fit_problem import FitProblem
from gfm.envs.pushes import ObjectErrors, errors_under, make_pushes, object_errors
from gfm.experiments.fit_warm import joint_errors
from gfm.experiments.joint_control import ForceModel, ModelErrors, make_test
from gfm.report import ModelKind


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What a model leaves of held-out recordings.

    Attributes:
        overall: Root mean square of the joints' positions, rad.
        joints: The same of each joint.
        pushed: Of the object; None where there is none.
    """

    overall: float
    joints: tuple[float, ...]
    pushed: ObjectErrors | None = None


class Judge(ABC):
    """Held-out recordings.

    Attributes:
        joint_names: Of the recordings.
        noise: Of the joints' positions, rad, shape (J,).
    """

    def __init__(self, joint_names: tuple[str, ...], noise: Array) -> None:
        self.joint_names, self.noise = joint_names, noise

    @abstractmethod
    def errors(self, forces: ForceModel | None, fitted: FitProblem) -> Judged:
        """Returns what is left under forces; under the nominal model without.

        Args:
            forces: What was learned.
            fitted: What it was learned in.
        """


def make_judge(
    robot: NominalModel,
    training: Sequence[Trajectory],
    held_out: Sequence[Trajectory],
    pushes: bool,
) -> Judge:
    """Returns the one that suits the model.

    Args:
        robot: The nominal model.
        training: Of these the noise is measured.
        held_out: To be predicted.
        pushes: Whether the model has an object.
    """
    return _Pushes(training, held_out) if pushes else _Arm(robot, training, held_out)


@final
class _Arm(Judge):
    """Whole recordings, but for what a slightly wrong initial state explains."""

    def __init__(
        self, robot: NominalModel, training: Sequence[Trajectory], held_out: Sequence[Trajectory]
    ) -> None:
        noise = measure_noise(training)
        self._test = make_test(robot.specs, held_out, noise, robot.effects)
        super().__init__(self._test.problem.joints, noise.position)

    @override
    def errors(self, forces: ForceModel | None, fitted: FitProblem) -> Judged:
        found: ModelErrors = (
            self._test.model_errors(ModelKind.NOMINAL, (), "")
            if forces is None
            else self._test.hybrid_errors(ModelKind.HYBRID, forces, fitted.model, "")
        )
        return Judged(overall=found.overall, joints=found.joints)


@final
class _Pushes(Judge):
    """Pushes of the object, the robot moving as it was measured; the joints through all of it."""

    def __init__(self, training: Sequence[Trajectory], held_out: Sequence[Trajectory]) -> None:
        super().__init__(training[0].joint_names, measure_noise(training).position)
        self._held_out = held_out

    @override
    def errors(self, forces: ForceModel | None, fitted: FitProblem) -> Judged:
        model = fitted.model
        pushes = make_pushes(model, self._held_out)
        if forces is None:
            pushed = object_errors(model, pushes)
        else:
            pushed = errors_under(forces.policy, forces.features, model, pushes)
        joints = tuple(joint_errors(model, self._held_out).tolist())
        overall = float(np.sqrt(np.mean(np.square(joints))))
        return Judged(overall=overall, joints=joints, pushed=pushed)
