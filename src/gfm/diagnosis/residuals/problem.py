"""A diagnosis as a least-squares problem: stretches, model, noise, and residuals of candidates.

Residuals are measured minus predicted, in units of the sensor noise, over open-loop rollouts. What
a wrong initial state could explain is taken out of them: it is fitted, to first order, segment by
segment (two numbers per joint, and two more where a motor rings against its link).

Stretches that a model misses by far more than the others (a fall, a stall) would decide everything
by their squares: what is outlying counts little more than what is not (`outliers`).

Shape letters: T measurements of a segment, J joints, N numbers of all segments together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from scipy.signal import savgol_filter
from typing_extensions import override

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import mean_square
from gfm.diagnosis.inference.score import SegmentShape
from gfm.diagnosis.residuals.clock import Clock
from gfm.diagnosis.residuals.outliers import OUTLYING, bounded
from gfm.diagnosis.residuals.segmented import SegmentedProblem
from gfm.effects import EffectInstance
from gfm.effects.effect import MOTOR_SIDE
from gfm.sim.motor_sides import Spring, springs
from gfm.sim.plant import Plant, make_plant
from gfm.sim.predict import predict
from gfm.sim.segment import Prediction, Segment, extrapolated

#: Steps in position and velocity with which the effect of the initial state is measured.
STATE_STEP = (1e-4, 1e-3)
#: Times that initial states are looked for anew around where they were found, steps that are taken
#: there with the same derivatives, and the shares of a step that are tried. What rings is far from
#: linear.
STATE_ROUNDS, STATE_SHARES = 2, (1.0,)
RINGING_ROUNDS, RINGING_STEPS, RINGING_SHARES = 16, 2, (1.0, 0.3, 0.1)
#: Mean square, in units of the noise, up to which a stretch has been followed, and the share of it
#: that another one that rings must have gained to be looked at again.
FOLLOWED, STATE_GAIN = 1.5, 0.1
#: Frequency from which on a motor has a state of its own at first, unless a servo leads it; a
#: slower one is taken for where its load holds it: half a second tells its state from no law.
RINGS_HZ = 4.0
#: Order of the polynomials that follow, over two swings of such a motor, what changes more slowly.
SLOW_ORDER = 4
#: How far a spring is bent at most, in units of what its drive's largest torque bends it: what
#: rings for long has been driven at its own frequency.
MOST_BENT = 10.0
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
        own = [_without(part, b) for part, b in zip(parts, self.state_basis, strict=True)]
        ringing = ringing_springs(self, effects)
        if not ringing:
            return own
        columns = _state_columns(self, effects, _motor_steps(len(self.joints), ringing))
        rows = zip(self.segments, own, columns, self.state_basis, predictions, strict=True)
        for i, (segment, part, motors, basis, prediction) in enumerate(rows):
            if not _led(segment):
                beside = _without(motors, basis)
                room = _room(segment, prediction, ringing)
                own[i] = min(
                    part, part + beside @ _rung(segment, part, beside, room), key=np.linalg.norm
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
        """Returns the problem with limits from what `effects` leave in a typical stretch."""
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
        basis = tuple(_orthonormal(part[: segment.position.size]) for part, segment in rows)
        return replace(self, segments=segments, state_basis=basis)

    def as_measured(self) -> Problem:
        """Returns the problem with every stretch begun as it was measured, to the letter."""
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
        free = [i for i, s in enumerate(self.segments) if not _led(s)]
        problem = timed(self, effects)
        if not free:
            return problem
        part = _freely_settled(problem.subset(free), effects)
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


def unsettled(problem: Problem, effects: Sequence[EffectInstance]) -> Problem:
    """Returns the problem with initial states as measured, and what they explain under `effects`.

    What suited a model that was wrong holds the next one there: it is bent to begin as that did.
    """
    return with_state_basis(problem.as_measured(), effects).robust(effects)


def _led(segment: Segment) -> bool:
    """Returns whether servos keep the joints on track."""
    return segment.kind is not CommandKind.EFFORT and bool((segment.servo_gain > 0.0).all())


def ringing_springs(problem: Problem, effects: Sequence[EffectInstance]) -> list[Spring]:
    """Returns the springs whose motors have states of their own at first, under `effects`."""
    if not problem.motors_apart([effects]) or all(_led(s) for s in problem.segments):
        return []
    added = (*problem.given, *effects)
    plant = make_plant(next(iter(problem.specs.values())), problem.joints, added)
    return [spring for spring in springs(plant) if spring.ringing_hz >= RINGS_HZ]


def _room(segment: Segment, prediction: Prediction, ringing: Sequence[Spring]) -> Array:
    """Returns how far motors' states can change beside their links', in steps, shape (2, 2 M).

    Downward and upward, so that no spring is bent farther than its drive could.
    """
    joints = [one.joint for one in ringing]
    stiffness = np.array([one.stiffness for one in ringing])
    angles = MOST_BENT * np.abs(prediction.effort[:, joints]).max(axis=0) / stiffness
    speeds = 2.0 * np.pi * angles * [one.ringing_hz for one in ringing]
    now = np.zeros((2, len(joints)))
    if segment.initial_motor is not None:
        now = segment.initial_motor[:, joints]
    most, sizes = np.stack([angles, speeds]), np.array(STATE_STEP)[:, None]
    return np.stack([((-most - now) / sizes).ravel(), ((most - now) / sizes).ravel()])


def _without(values: Array, basis: Array) -> Array:
    """Returns columns without what an orthonormal basis explains of them."""
    return np.asarray(values - basis @ (basis.T @ values))


def _rung(segment: Segment, part: Array, columns: Array, room: Array) -> Array:
    """Returns by how much motors' states change so that less rings in a residual, shape (2 M,).

    In steps. What changes more slowly may as well tell of laws that are missing.

    Args:
        segment: Whose residual it is.
        part: The residual, without what links' states explain, shape (N,).
        columns: What motors' states change of that, shape (N, 2 M).
        room: Within which they are looked for, shape (2, 2 M).
    """
    both = np.concatenate([columns, part[:, None]], axis=1)
    fast = both - _slow(segment, both)
    amounts = np.linalg.lstsq(fast[:, :-1], fast[:, -1], rcond=1e-6)[0]
    return np.asarray(np.clip(-amounts, np.minimum(room[0], 0.0), np.maximum(room[1], 0.0)))


def _slow(segment: Segment, columns: Array) -> Array:
    """Returns what of columns, shape (N, M), changes more slowly than a motor rings."""
    count, joints = segment.position.shape
    period_s = float(segment.time_s[-1]) / (count - 1)
    window = min(round(2.0 / RINGS_HZ / period_s), count) // 2 * 2 - 1
    series = columns.reshape(-1, count, joints, columns.shape[1])
    if window <= SLOW_ORDER:
        return columns
    return np.asarray(savgol_filter(series, window, SLOW_ORDER, axis=1).reshape(columns.shape))


def _freely_settled(problem: Problem, effects: Sequence[EffectInstance]) -> Problem:
    """Returns a problem that no servo leads, with initial states that fit best, and their bases.

    Stretches that are followed as they begin stay as they are.
    """
    ringing, joints = ringing_springs(problem, effects), len(problem.joints)
    steps = np.concatenate([_link_steps(joints), _motor_steps(joints, ringing)])
    segments, bases = list(problem.segments), dict(enumerate(problem.state_basis))
    left = enumerate(_whitened(problem, effects))
    open_ = [i for i, r in left if i not in bases or mean_square(r) >= FOLLOWED]
    for _ in range(RINGING_ROUNDS if ringing else STATE_ROUNDS):
        if not open_:
            break
        part = replace(problem, segments=tuple(segments)).subset(open_)
        columns = _state_columns(part, effects, steps)
        part, gains = _nearer(part, effects, columns, steps, ringing)
        for i, segment, own in zip(open_, part.segments, columns, strict=True):
            segments[i], bases[i] = segment, _orthonormal(own[:, : 2 * joints])
        least = STATE_GAIN if ringing else 0.0
        open_ = [i for i, gain in zip(open_, gains, strict=True) if gain > least]
    there = replace(problem, segments=tuple(segments)).subset(open_)
    bases |= dict(zip(open_, with_state_basis(there, effects).state_basis, strict=True))
    own_bases = tuple(bases[i] for i in range(len(segments)))
    return replace(problem, segments=tuple(segments), state_basis=own_bases)


def _nearer(
    problem: Problem,
    effects: Sequence[EffectInstance],
    columns: Sequence[Array],
    steps: Array,
    ringing: Sequence[Spring],
) -> tuple[Problem, list[float]]:
    """Returns the problem with initial states some Gauss-Newton steps better.

    And the share of its squared residual that each segment gained; none where it is followed.

    Args:
        problem: Whose initial states are looked for.
        effects: Of the model.
        columns: By how much each step of an initial state changes residuals, (N, S) each.
        steps: See `_state_columns`, shape (S, 4, J).
        ringing: Springs whose motors have states of their own.
    """
    predictions = problem.predictions([effects])[0]
    left = [problem.whitened(*row) for row in zip(problem.segments, predictions, strict=True)]
    before = [mean_square(residual) for residual in left]
    for _ in range(RINGING_STEPS if ringing else 1):
        segments, trying = list(problem.segments), list(range(len(left)))
        rooms = [_room(*row, ringing) for row in zip(segments, predictions, strict=True)]
        rows = zip(segments, left, columns, rooms, strict=True)
        changes = [np.tensordot(_best_amounts(*row), steps, axes=1) for row in rows]
        for share in RINGING_SHARES if ringing else STATE_SHARES:
            moved = [_moved(problem.segments[i], share * changes[i]) for i in trying]
            part = replace(problem.subset(trying), segments=tuple(moved))
            after = dict(zip(trying, _whitened(part, effects), strict=True))
            better = {i for i in trying if mean_square(after[i]) < mean_square(left[i])}
            for i, segment in zip(trying, moved, strict=True):
                if i in better:
                    segments[i], left[i] = segment, after[i]
            trying = [i for i in trying if i not in better]
            if not trying:
                break
        problem = replace(problem, segments=tuple(segments))
    costs = [mean_square(residual) for residual in left]
    gains = [0.0 if c < FOLLOWED else 1.0 - c / b for b, c in zip(before, costs, strict=True)]
    return problem, gains


def _best_amounts(segment: Segment, residual: Array, columns: Array, room: Array) -> Array:
    """Returns the amounts of all steps of an initial state that leave least, shape (S,).

    Arguments as of `_rung`, but all of them: the columns of links first.
    """
    links, motors = np.split(columns, [columns.shape[1] - room.shape[1]], axis=1)
    basis = _orthonormal(links)
    rung = np.zeros(0)
    if room.size:
        rung = _rung(segment, _without(residual, basis), _without(motors, basis), room)
    own = np.linalg.lstsq(links, -residual - motors @ rung, rcond=1e-6)[0]
    return np.concatenate([own, rung])


def with_state_basis(problem: Problem, effects: Sequence[EffectInstance] = ()) -> Problem:
    """Returns the problem with what each initial state can explain, to first order."""
    columns = _state_columns(problem, effects, _link_steps(len(problem.joints)))
    return replace(problem, state_basis=tuple(_orthonormal(c) for c in columns))


def _link_steps(joints: int) -> Array:
    """Returns small changes of positions and velocities, one by one, shape (2 J, 4, J)."""
    return np.diag(np.repeat((*STATE_STEP, 0.0, 0.0), joints))[: 2 * joints].reshape(-1, 4, joints)


def _motor_steps(joints: int, ringing: Sequence[Spring]) -> Array:
    """Returns small changes of motors' states beside their links', one by one, (2 M, 4, J)."""
    each = np.diag(np.repeat((0.0, 0.0, *STATE_STEP), joints)).reshape(-1, 4, joints)
    return each[[side * joints + one.joint for side in (2, 3) for one in ringing]]


def _state_columns(
    problem: Problem, effects: Sequence[EffectInstance], steps: Array
) -> list[Array]:
    """Returns by how much each step of an initial state changes residuals, (N, S) each.

    Args:
        problem: Whose initial states are changed.
        effects: Of the model.
        steps: Positions, velocities, and the same of motors beside their links, shape (S, 4, J).
    """
    fast = problem.coarse()
    base = _whitened(fast, effects)
    columns: list[list[Array]] = [[] for _ in problem.segments]
    for step in steps:
        moved = replace(fast, segments=tuple(_moved(s, step) for s in problem.segments))
        for own, before, after in zip(columns, base, _whitened(moved, effects), strict=True):
            own.append(after - before)
    return [np.stack(own, axis=1) for own in columns]


def _whitened(problem: Problem, effects: Sequence[EffectInstance]) -> list[Array]:
    predictions = problem.predictions([effects])[0]
    return [problem.whitened(s, p) for s, p in zip(problem.segments, predictions, strict=True)]


def _moved(segment: Segment, change: Array) -> Segment:
    """Returns a segment that begins elsewhere, see `_state_columns`, shape (4, J)."""
    motor = change[2:] if segment.initial_motor is None else segment.initial_motor + change[2:]
    return replace(
        segment,
        initial_position=segment.initial_position + change[0],
        initial_velocity=segment.initial_velocity + change[1],
        initial_motor=motor,
        measured=segment.measured or segment,
    )


def _orthonormal(columns: Array) -> Array:
    """Returns an orthonormal basis of the columns, without directions that are numerical noise.

    A column is nothing where an initial state changes nothing: where a simulation ran away.
    """
    sizes = np.linalg.norm(columns, axis=0)
    acting = sizes > 0.0
    if not acting.any():
        return columns[:, :0]
    left, shares, _ = np.linalg.svd(columns[:, acting] / sizes[acting], full_matrices=False)
    return np.asarray(left[:, shares > 1e-3 * shares[0]])
