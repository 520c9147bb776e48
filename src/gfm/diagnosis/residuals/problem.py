"""A diagnosis as a least-squares problem: segments, model, noise, and residuals of candidates.

Residuals are measured minus predicted, in units of the sensor noise, over open-loop rollouts. What
a wrong initial state could explain is taken out of them: it is fitted, to first order, segment by
segment (two numbers per joint, and two more where a motor rings against its link).

Segments that a model misses by far more than the others (a fall, a stall) would decide everything
by their squares: what is outlying counts little more than what is not (`outliers`).

Shape letters: T measurements of a segment, J joints, N numbers of all segments together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from typing_extensions import override

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.diagnosis.inference.score import SegmentShape
from gfm.diagnosis.residuals.clock import Clock
from gfm.diagnosis.residuals.initial_states import (
    freely_settled,
    led,
    motor_steps,
    orthonormal,
    ringing_springs,
    room_of,
    rung,
    state_columns,
    without,
)
from gfm.diagnosis.residuals.outliers import OUTLYING, bounded
from gfm.diagnosis.residuals.segmented import SegmentedProblem
from gfm.effects import EffectInstance
from gfm.effects.effect import MOTOR_SIDE
from gfm.sim.plant import Plant, make_plant
from gfm.sim.predict import predict
from gfm.sim.segment import Prediction, Segment, extrapolated

#: Largest residual that counts, in units of the noise: a simulation that runs away stays finite.
LARGEST = 1e5


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem(SegmentedProblem):
    """Recordings and the model that should explain them.

    Attributes:
        specs: The nominal model by command kind.
        joints: The measured joints.
        segments: What is predicted.
        noise: Of the sensors.
        after_command: Whether efforts were measured after the command of the same stamp.
        state_basis: Per segment, an orthonormal basis of what the initial state can explain,
            shape (T * channels, 2 J).
        outlying_from: Residuals from which on they are outlying, by joint for positions and
            efforts, in units of the noise, shape (2, J).
        given: Effects of the nominal model that its specs cannot say: every candidate has them.
        stepping: How models are simulated, by command kind; as they say where there is none. Where
            a motor is apart from its link, on the model's own step: what rings between them is
            fast.
        still: Joints that the models drive and nobody recorded, and where they are taken to stand
            still, rad or m.
        rough: Whether they are simulated faster and less exactly.
        clock: Breaks off what takes too long.
    """

    specs: Mapping[CommandKind, mujoco.MjSpec]
    joints: tuple[str, ...]
    segments: tuple[Segment, ...]
    noise: Noise
    after_command: bool = False
    state_basis: tuple[Array, ...] = field(default=())
    outlying_from: Array | None = None
    given: tuple[EffectInstance, ...] = ()
    stepping: Mapping[CommandKind, Stepping] = field(default_factory=dict)
    still: Mapping[str, float] = field(default_factory=dict)
    rough: bool = False
    clock: Clock = field(default_factory=Clock)

    @property
    @override
    def separated(self) -> set[tuple[str, ...]]:
        """Joints whose motor the model has apart from the link already, each as a place."""
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

    def is_implicit(self, kind: CommandKind) -> bool:
        """Returns whether the model of that kind of command is integrated implicitly."""
        return kind in self.stepping and self.stepping[kind].implicit

    def motors_apart(self, candidates: Sequence[Sequence[EffectInstance]]) -> bool:
        """Returns whether a motor is apart from its link in the model or a candidate."""
        added = [*self.given, *(one for effects in candidates for one in effects)]
        return bool(self.separated) or any(one.effect.separates_motor for one in added)

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
        kinds = list(dict.fromkeys(segment.kind for segment in self.segments))
        rows: list[list[Prediction | None]] = [[None] * len(self.segments) for _ in candidates]
        asked = efforts or self.motors_apart(candidates)
        for kind in kinds:
            places = [i for i, s in enumerate(self.segments) if s.kind is kind]
            here = [self.segments[i] for i in places]
            told = [
                predict(plants, here, after_command=self.after_command, efforts=asked)
                for plants in self._plants(kind, candidates)
            ]
            for row, *answers in zip(rows, *told, strict=True):
                for i, *answer in zip(places, *answers, strict=True):
                    row[i] = extrapolated(*answer)
        return [[p for p in row if p is not None] for row in rows]

    def _plants(
        self, kind: CommandKind, candidates: Sequence[Sequence[EffectInstance]]
    ) -> list[list[Plant]]:
        """Returns the plants to simulate: on one step, or on one and on its half."""
        spec = self.specs[kind].copy()
        own = Stepping(step_s=float(spec.option.timestep))
        stepping = self.stepping.get(kind, own)
        if self.motors_apart(candidates):
            stepping = replace(stepping, step_s=own.step_s)
        elif self.rough and not stepping.implicit:
            stepping = replace(stepping, step_s=2.0 * stepping.step_s)
        if stepping.implicit:
            spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
        elif self.rough:
            spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        once = not stepping.implicit or self.rough
        plants = []
        for one in (stepping,) if once else (stepping, stepping.halved()):
            spec.option.timestep = one.step_s
            plants.append([make_plant(spec, self.joints, (*self.given, *c)) for c in candidates])
        return plants

    @override
    def residuals(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        """Returns the residual of every candidate, initial states fitted, shape (candidates, N)."""
        rows = zip(candidates, self.predictions(candidates), strict=True)
        return np.stack([self._bounded(self._fitted(*row)) for row in rows])

    def _fitted(
        self, effects: Sequence[EffectInstance], predictions: Sequence[Prediction]
    ) -> list[Array]:
        """Returns what is left of each segment without what its initial state can explain."""
        parts = [self.whitened(s, p) for s, p in zip(self.segments, predictions, strict=True)]
        if not self.state_basis:
            return parts
        own = [without(part, b) for part, b in zip(parts, self.state_basis, strict=True)]
        ringing = ringing_springs(self, effects)
        if not ringing:
            return own
        columns = state_columns(self, effects, motor_steps(len(self.joints), ringing))
        rows = zip(self.segments, own, columns, self.state_basis, predictions, strict=True)
        for i, (segment, part, motors, basis, prediction) in enumerate(rows):
            if not led(segment):
                beside = without(motors, basis)
                room = room_of(segment, prediction, ringing)
                own[i] = min(
                    part, part + beside @ rung(segment, part, beside, room), key=np.linalg.norm
                )
        return own

    def _bounded(self, parts: Sequence[Array]) -> Array:
        return bounded(np.concatenate(parts), self.limits())

    def limits(self) -> Array | None:
        """Returns from where on each number is outlying, shape (N,); None where none is."""
        if self.outlying_from is None:
            return None
        return np.concatenate([self._by_number(self.outlying_from, s) for s in self.segments])

    def _by_number(self, limits: Array, segment: Segment) -> Array:
        count = len(segment.position)
        channels = self._size(segment) // segment.position.size
        return np.concatenate([np.tile(limits[c], count) for c in range(channels)])

    @override
    def robust(self, effects: Sequence[EffectInstance]) -> Problem:
        """Returns the problem with limits from what `effects` leave in a typical segment."""
        residual = self.plain().residuals([effects])[0]
        joints = len(self.joints)
        sizes: list[list[Array]] = [[], []]
        for segment, rows in zip(self.segments, self.slices(), strict=True):
            channels = residual[rows].reshape(-1, len(segment.position), joints)
            for channel, values in enumerate(channels):
                sizes[channel].append(np.sqrt(np.mean(values**2, axis=0)))
        typical = [np.median(s, axis=0) if s else np.ones(joints) for s in sizes]
        return replace(self, outlying_from=OUTLYING * np.maximum(np.stack(typical), 1.0))

    def whitened(self, segment: Segment, prediction: Prediction) -> Array:
        """Returns measured minus predicted in units of the noise, position before effort."""
        channels = [(segment.position - prediction.position) / self.noise.position]
        if segment.effort is not None and segment.effort_noise is not None:
            channels.append((segment.effort - prediction.effort) / segment.effort_noise)
        flat = np.concatenate([channel.ravel() for channel in channels])
        return np.asarray(np.clip(np.nan_to_num(flat, nan=LARGEST), -LARGEST, LARGEST))

    def position_errors(self, effects: Sequence[EffectInstance]) -> list[Array]:
        """Returns measured minus predicted position, initial state fitted, per segment (T, J)."""
        parts = self._fitted(effects, self.predictions([effects])[0])
        return [
            part[: s.position.size].reshape(s.position.shape) * self.noise.position
            for s, part in zip(self.segments, parts, strict=True)
        ]

    @property
    @override
    def has_efforts(self) -> bool:
        """Whether efforts are predicted beside positions."""
        return any(self._size(s) > s.position.size for s in self.segments)

    @override
    def positions_alone(self) -> Problem:
        """Returns the problem without efforts."""
        segments = tuple(replace(segment, effort=None) for segment in self.segments)
        rows = zip(self.state_basis, segments, strict=True)
        basis = tuple(orthonormal(part[: segment.position.size]) for part, segment in rows)
        return replace(self, segments=segments, state_basis=basis)

    def as_measured(self) -> Problem:
        """Returns the problem with every segment begun as it was measured, to the letter."""
        segments = tuple(segment.measured or segment for segment in self.segments)
        return replace(self, segments=segments, state_basis=())

    def effort_misfit(self, effects: Sequence[EffectInstance]) -> float:
        """Returns by how much efforts are missed, N m: the medians of all segments, added up."""
        told = zip(self.segments, self.predictions([effects])[0], strict=True)
        return sum(
            float(np.median(np.abs(segment.effort - prediction.effort)))
            for segment, prediction in told
            if segment.effort is not None
        )

    def _size(self, segment: Segment) -> int:
        both = segment.effort is not None and segment.effort_noise is not None
        return segment.position.size * (2 if both else 1)

    @override
    def layout(self) -> list[SegmentShape]:
        """Returns what each segment's numbers are."""
        return [
            SegmentShape(
                recording=segment.recording,
                duration_s=float(segment.time_s[-1]),
                channels=self._size(segment) // segment.position.size,
                measurements=len(segment.position),
            )
            for segment in self.segments
        ]

    @override
    def plain(self) -> Problem:
        return replace(self, outlying_from=None)

    @override
    def subset(self, keep: Sequence[int]) -> Problem:
        """Returns the same problem with some of its segments only."""
        return replace(
            self,
            segments=tuple(self.segments[i] for i in keep),
            state_basis=tuple(self.state_basis[i] for i in keep) if self.state_basis else (),
        )

    @override
    def coarse(self) -> Problem:
        """Returns the problem with fast integration: good enough for differences of predictions.

        With no limits: it errs by more than these may be.
        """
        return replace(self, rough=True, outlying_from=None)

    def joined(self, other: Problem) -> Problem:
        """Returns the same problem with the segments of another one behind its own."""
        return replace(
            self,
            segments=(*self.segments, *other.segments),
            state_basis=(*self.state_basis, *other.state_basis),
        )

    @override
    def settled(self, effects: Sequence[EffectInstance]) -> Problem:
        """Returns the problem with initial states, and times of efforts, that fit best.

        Where nothing leads a joint back, what a segment begins with counts to its end, and by more
        than to first order. A servo forgets it: its segments stay as they are.
        """
        free = [i for i, s in enumerate(self.segments) if not led(s)]
        problem = timed(self, effects)
        if not free:
            return problem
        part = freely_settled(problem.subset(free), effects)
        segments, bases = list(problem.segments), list(problem.state_basis)
        for i, segment, basis in zip(free, part.segments, part.state_basis, strict=True):
            segments[i], bases[i] = segment, basis
        return replace(problem, segments=tuple(segments), state_basis=tuple(bases))

    @override
    def sample(self, simulated_s: float, of_each: int = 0) -> list[int]:
        """Returns segments, spread over the recordings and kinds, of about so much time in all.

        Args:
            simulated_s: Recorded time, s.
            of_each: Segments of each recording that are taken in any case.
        """
        by_recording = sorted(range(len(self.segments)), key=lambda i: self._turn(i))
        return self.first(by_recording, simulated_s, of_each)

    def first(self, order: Sequence[int], simulated_s: float, of_each: int = 0) -> list[int]:
        """Returns the first segments, in an order, of about so much time in all: see `sample`."""
        chosen, total_s = [], 0.0
        taken: Counter[int] = Counter()
        for i in order:
            here = self.segments[i]
            if total_s < simulated_s or taken[here.recording] < of_each:
                chosen.append(i)
                taken[here.recording] += 1
                total_s += float(here.time_s[-1])
        return sorted(chosen)

    def _turn(self, index: int) -> tuple[int, int, int]:
        """Returns a key by which kinds take turns, within a kind recordings, then segments."""
        here = self.segments[index]
        same_kind = sorted({s.recording for s in self.segments if s.kind is here.kind})
        within = [i for i, s in enumerate(self.segments) if s.recording == here.recording]
        place = within.index(index)
        # A golden-ratio order takes windows from all over a recording before their neighbours.
        spread = int((place * 0.618033988749895 % 1.0) * len(within))
        return (spread * len(same_kind) + same_kind.index(here.recording), here.recording, place)


def timed(problem: Problem, effects: Sequence[EffectInstance]) -> Problem:
    """Returns the problem with efforts taken before or after the command of the same stamp.

    As they fit better under `effects`.
    """
    if problem.noise.effort is None:
        return problem
    both = [replace(problem, after_command=after) for after in (False, True)]
    return min(both, key=lambda one: one.effort_misfit(effects))
