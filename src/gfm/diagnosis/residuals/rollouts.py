"""Rollouts of a model beside recordings: predictions, and what they leave of what was measured.

Residuals are measured minus predicted, in units of the sensor noise, over open-loop rollouts that
begin as their segments say.

Shape letters: T measurements of a segment, J joints, N numbers of a segment.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import mujoco
import numpy as np
from typing_extensions import override

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.core.deadline import Clock
from gfm.diagnosis.residuals.segmented import SegmentedProblem
from gfm.diagnosis.residuals.simulated import Simulated
from gfm.effects import EffectInstance
from gfm.effects.effect import MOTOR_SIDE
from gfm.sim.commands import BEFORE, InForce
from gfm.sim.plant import Plant, make_plant
from gfm.sim.predict import predict
from gfm.sim.segment import Prediction, Segment, extrapolated

#: Largest residual that counts, in units of the noise: a simulation that runs away stays finite.
LARGEST = 1e5
#: Longest step on which a motor apart from its link is simulated, s, unless the model's own is
#: longer: the stops of a play give way within four of them.
MOTOR_STEP_S = 1e-3


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Standard deviations of the sensor noise, by joint.

    Attributes:
        position: rad, shape (J,).
        effort: The typical one, for recordings that do not show their own, N m, shape (J,), or
            None where no recording has effort.
    """

    position: Array
    effort: Array | None


@dataclass(frozen=True, kw_only=True)
class Stepping:
    """How a model is simulated.

    Attributes:
        step_s: Time step, s.
        implicit: Whether by MuJoCo's `discrete` integrator, once on such steps and once on half of
            them, as if going on to ever shorter ones (Richardson extrapolation), where Runge-Kutta
            does not follow the model on such a step.
    """

    step_s: float
    implicit: bool = False

    def halved(self) -> Stepping:
        """Returns the same on half the step."""
        return replace(self, step_s=0.5 * self.step_s)


class Way(NamedTuple):
    """One simulation: its time step, s, and MuJoCo's number of its integrator."""

    step_s: float
    integrator: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Rollouts(SegmentedProblem):
    """Recordings and the model that should explain them.

    Attributes:
        specs: The nominal model by command kind.
        noise: Of the sensors.
        in_force: Under which commands of nearly the same stamp efforts were measured.
        stepping: How models are simulated, by command kind; as they say where there is none. Where
            a motor is apart from its link, on short steps: what rings between them is fast.
        still: Joints that the models drive and nobody recorded, and where they stand, rad or m.
        air: First row, and the one behind the last, of the pieces of each recording in which the
            robot touches nothing, if segments are of those only; empty if they are of all.
        rough: Whether they are simulated faster and less exactly.
        clock: Breaks off what takes too long.
        simulated: What was predicted before.
    """

    specs: Mapping[CommandKind, mujoco.MjSpec]
    segments: tuple[Segment, ...]
    noise: Noise
    in_force: InForce = BEFORE
    stepping: Mapping[CommandKind, Stepping] = field(default_factory=dict)
    still: Mapping[str, float] = field(default_factory=dict)
    air: Mapping[int, Sequence[tuple[int, int]]] = field(default_factory=dict)
    rough: bool = False
    clock: Clock = field(default_factory=Clock)
    simulated: Simulated = field(default_factory=Simulated)

    @property
    @override
    def separated(self) -> set[tuple[str, ...]]:
        model = {joint.name for spec in self.specs.values() for joint in spec.joints}
        return {(name,) for name in self.joints if name + MOTOR_SIDE in model}

    @property
    def driven(self) -> tuple[str, ...]:
        """Joints whose drive is on somewhere."""
        on = np.any([segment.servo_gain > 0.0 for segment in self.segments], axis=0)
        return tuple(name for name, there in zip(self.joints, on, strict=True) if there)

    @property
    def pushing(self) -> bool:
        """Whether the robot touches an object whose place is known."""
        touching = any(
            not spec.option.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
            for spec in self.specs.values()
        )
        return touching and any(s.object_pose is not None for s in self.segments)

    def plants(self, effects: Sequence[EffectInstance]) -> dict[CommandKind, Plant]:
        """Returns the model with `effects` in it by kind of command."""
        added = (*self.given, *effects)
        return {kind: make_plant(spec, self.joints, added) for kind, spec in self.specs.items()}

    def is_implicit(self, kind: CommandKind) -> bool:
        """Returns whether the model of that kind of command is integrated implicitly."""
        return kind in self.stepping and self.stepping[kind].implicit

    def motors_apart(self, candidates: Sequence[Sequence[EffectInstance]]) -> bool:
        """Returns whether a motor is apart from its link in the model or a candidate."""
        added = [*self.given, *(one for effects in candidates for one in effects)]
        return bool(self.separated) or any(one.effect.separates_motor for one in added)

    def _motors_ring(self, candidates: Sequence[Sequence[EffectInstance]]) -> bool:
        """Returns whether a motor may ring: how far is told by what its drive gives."""
        added = [*self.given, *(one for effects in candidates for one in effects)]
        return bool(self.separated) or any(one.effect.rings for one in added)

    def predictions(
        self, candidates: Sequence[Sequence[EffectInstance]], *, efforts: bool = False
    ) -> list[list[Prediction]]:
        """Returns every candidate's prediction of every segment, candidates first.

        Args:
            candidates: What to add to the nominal model.
            efforts: Whether to tell efforts where none were measured, too.

        Raises:
            OutOfTimeError: the time of the search is over.
        """
        self.clock.check()
        rows: list[dict[int, Prediction]] = [{} for _ in candidates]
        asked = efforts or self._motors_ring(candidates)
        for kind in dict.fromkeys(segment.kind for segment in self.segments):
            places = [i for i, s in enumerate(self.segments) if s.kind is kind]
            told = self._of_kind(kind, [self.segments[i] for i in places], candidates, asked)
            for row, answers in zip(rows, told, strict=True):
                row.update(zip(places, answers, strict=True))
        return [[row[i] for i in range(len(self.segments))] for row in rows]

    def _of_kind(
        self,
        kind: CommandKind,
        segments: Sequence[Segment],
        candidates: Sequence[Sequence[EffectInstance]],
        efforts: bool,
    ) -> list[list[Prediction]]:
        """Returns every candidate's prediction of segments under one kind of command."""
        ways = self._ways(kind, candidates)

        def simulate(asked: list[int]) -> list[list[Prediction]]:
            told = [
                predict(
                    self._plants(kind, [candidates[i] for i in asked], way),
                    segments,
                    in_force=self.in_force,
                    efforts=efforts,
                )
                for way in ways
            ]
            rows = zip(*told, strict=True)
            return [list(map(extrapolated, *answers)) for answers in rows]

        given = _amounts(self.given)
        how = (self.specs[kind], *ways, self.in_force, efforts)
        models = [(*how, given, _amounts(effects)) for effects in candidates]
        return self.simulated.each(models, segments, simulate)

    def _ways(self, kind: CommandKind, candidates: Sequence[Sequence[EffectInstance]]) -> list[Way]:
        """Returns how candidates are simulated: on one step, or on one and on its half."""
        option = self.specs[kind].option
        own = Stepping(step_s=float(option.timestep))
        stepping = self.stepping.get(kind, own)
        if self.motors_apart(candidates):
            longest_s = max(own.step_s, MOTOR_STEP_S)
            stepping = replace(stepping, step_s=min(stepping.step_s, longest_s))
        elif self.rough and not stepping.implicit:
            stepping = replace(stepping, step_s=2.0 * stepping.step_s)
        if stepping.implicit:
            steps = (stepping,) if self.rough else (stepping, stepping.halved())
            return [Way(one.step_s, mujoco.mjtIntegrator.mjINT_DISCRETE) for one in steps]
        rough = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        return [Way(stepping.step_s, rough if self.rough else option.integrator)]

    def _plants(
        self, kind: CommandKind, candidates: Sequence[Sequence[EffectInstance]], way: Way
    ) -> list[Plant]:
        spec = self.specs[kind].copy()
        spec.option.timestep, spec.option.integrator = way
        return [make_plant(spec, self.joints, (*self.given, *c)) for c in candidates]

    def whitened(self, predictions: Sequence[Prediction]) -> list[Array]:
        """Returns measured minus predicted in units of the noise, segment by segment, (N,) each.

        Position before effort.
        """
        parts = []
        for segment, prediction in zip(self.segments, predictions, strict=True):
            channels = [(segment.position - prediction.position) / self.noise.position]
            if segment.effort is not None and segment.effort_noise is not None:
                channels.append((segment.effort - prediction.effort) / segment.effort_noise)
            flat = np.concatenate([channel.ravel() for channel in channels])
            parts.append(np.clip(np.nan_to_num(flat, nan=LARGEST), -LARGEST, LARGEST))
        return parts

    @property
    @override
    def channels(self) -> list[int]:
        return [1 if s.effort is None or s.effort_noise is None else 2 for s in self.segments]

    @override
    def coarse(self) -> Self:
        """Returns the problem with fast integration: good enough for differences of predictions.

        With no limits: it errs by more than these may be.
        """
        return replace(self, rough=True, outlying_from=np.inf)


def _amounts(effects: Sequence[EffectInstance]) -> Hashable:
    """Returns what predictions depend on of effects."""
    return tuple((*one.key, *sorted(one.values.items()), one.in_model) for one in effects)
