"""Initial states: what of a residual they explain, and which fit best.

What a wrong initial state could explain is taken out of a residual, to first order, segment by
segment: two numbers per joint, and two more where a motor rings against its link. Where no servo
leads a joint, what a segment begins with counts to its end, and states are looked for.

Shape letters: T measurements of a segment, J joints, M motors that ring, N numbers of a segment, S
steps of an initial state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from scipy.signal import savgol_filter

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import mean_square, without
from gfm.diagnosis.residuals.rollouts import Rollouts
from gfm.effects import EffectInstance
from gfm.sim.motor_sides import Spring, springs
from gfm.sim.plant import make_plant
from gfm.sim.segment import Prediction, Segment

R = TypeVar("R", bound=Rollouts)

#: Steps in position and velocity with which the effect of the initial state is measured.
STATE_STEP = (1e-4, 1e-3)
#: Times that initial states are looked for anew around where they were found, steps that are taken
#: there with the same derivatives, and the shares of a step that are tried. What rings is far from
#: linear.
STATE_ROUNDS, STATE_SHARES = 2, (1.0,)
RINGING_ROUNDS, RINGING_STEPS, RINGING_SHARES = 16, 2, (1.0, 0.3, 0.1)
#: Mean square, in units of the noise, up to which a segment has been followed, and the share of it
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


def led(segment: Segment) -> bool:
    """Returns whether servos keep the joints on track."""
    return segment.kind is not CommandKind.EFFORT and bool((segment.servo_gain > 0.0).all())


def ringing_springs(problem: Rollouts, effects: Sequence[EffectInstance]) -> list[Spring]:
    """Returns the springs whose motors have states of their own at first, under `effects`."""
    if not problem.motors_apart([effects]) or all(led(s) for s in problem.segments):
        return []
    added = (*problem.given, *effects)
    plant = make_plant(next(iter(problem.specs.values())), problem.joints, added)
    return [spring for spring in springs(plant) if spring.ringing_hz >= RINGS_HZ]


def room_of(segment: Segment, prediction: Prediction, ringing: Sequence[Spring]) -> Array:
    """Returns how far motors' states can change beside their links', in steps, shape (2, 2 M).

    Downward and upward, so that no spring is bent farther than its drive could.
    """
    joints = [one.joint for one in ringing]
    stiffness = np.array([one.stiffness for one in ringing])
    angles = MOST_BENT * np.abs(prediction.effort[:, joints]).max(axis=0) / stiffness
    speeds = 2.0 * np.pi * angles * [one.ringing_hz for one in ringing]
    motor = segment.initial_motor
    now = np.zeros((2, len(joints))) if motor is None else motor[:, joints]
    most, sizes = np.stack([angles, speeds]), np.array(STATE_STEP)[:, None]
    return np.stack([((-most - now) / sizes).ravel(), ((most - now) / sizes).ravel()])


def rung(segment: Segment, part: Array, columns: Array, room: Array) -> Array:
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


def without_states(
    problem: Rollouts, effects: Sequence[EffectInstance], predictions: Sequence[Prediction]
) -> list[Array]:
    """Returns what is left of each segment without what its initial state can explain, (N,) each.

    Args:
        problem: Whose segments they are.
        effects: Of the model.
        predictions: What it predicts for each segment.
    """
    parts = problem.whitened(predictions)
    if not problem.state_basis:
        return parts
    own = [without(part, b) for part, b in zip(parts, problem.state_basis, strict=True)]
    ringing = ringing_springs(problem, effects)
    if not ringing:
        return own
    joints = len(problem.joints)
    columns = state_columns(problem, effects, state_steps(joints, ringing)[2 * joints :])
    rows = zip(problem.segments, own, columns, problem.state_basis, predictions, strict=True)
    for i, (segment, part, motors, basis, prediction) in enumerate(rows):
        if not led(segment):
            beside = without(motors, basis)
            change = rung(segment, part, beside, room_of(segment, prediction, ringing))
            own[i] = min(part, part + beside @ change, key=np.linalg.norm)
    return own


def freely_settled(problem: R, effects: Sequence[EffectInstance]) -> R:
    """Returns a problem with initial states that fit best where no servo leads, and their bases.

    Segments that are followed as they begin stay as they are.
    """
    free = [i for i, segment in enumerate(problem.segments) if not led(segment)]
    if not free:
        return problem
    ringing, joints = ringing_springs(problem, effects), len(problem.joints)
    steps = state_steps(joints, ringing)
    segments, bases = list(problem.segments), dict(enumerate(problem.state_basis))
    left = zip(free, _whitened(problem.subset(free), effects), strict=True)
    open_ = [i for i, r in left if i not in bases or mean_square(r) >= FOLLOWED]
    for _ in range(RINGING_ROUNDS if ringing else STATE_ROUNDS):
        if not open_:
            break
        part = replace(problem, segments=tuple(segments)).subset(open_)
        columns = state_columns(part, effects, steps)
        part, gains = _nearer(part, effects, columns, steps, ringing)
        for i, segment, own in zip(open_, part.segments, columns, strict=True):
            segments[i], bases[i] = segment, orthonormal(own[:, : 2 * joints])
        least = STATE_GAIN if ringing else 0.0
        open_ = [i for i, gain in zip(open_, gains, strict=True) if gain > least]
    there = replace(problem, segments=tuple(segments)).subset(open_)
    bases |= dict(zip(open_, with_state_basis(there, effects).state_basis, strict=True))
    own_bases = tuple(bases[i] for i in range(len(segments)))
    return replace(problem, segments=tuple(segments), state_basis=own_bases)


def _nearer(
    problem: R,
    effects: Sequence[EffectInstance],
    columns: Sequence[Array],
    steps: Array,
    ringing: Sequence[Spring],
) -> tuple[R, list[float]]:
    """Returns the problem with initial states some Gauss-Newton steps better.

    And the share of its squared residual that each segment gained; none where it is followed. By
    how much each of `steps`, (S, 4, J), changes residuals say `columns`, (N, S) each.
    """
    predictions = problem.predictions([effects])[0]
    left = problem.whitened(predictions)
    before = [mean_square(residual) for residual in left]
    for _ in range(RINGING_STEPS if ringing else 1):
        segments, trying = list(problem.segments), list(range(len(left)))
        rooms = [room_of(*row, ringing) for row in zip(segments, predictions, strict=True)]
        rows = zip(segments, left, columns, rooms, strict=True)
        changes = [np.tensordot(_best_amounts(*row), steps, axes=1) for row in rows]
        for share in RINGING_SHARES if ringing else STATE_SHARES:
            moved = [_moved(problem.segments[i], share * changes[i]) for i in trying]
            part = replace(problem.subset(trying), segments=tuple(moved))
            for i, segment, after in zip([*trying], moved, _whitened(part, effects), strict=True):
                if mean_square(after) < mean_square(left[i]):
                    segments[i], left[i] = segment, after
                    trying.remove(i)
            if not trying:
                break
        problem = replace(problem, segments=tuple(segments))
    costs = [mean_square(residual) for residual in left]
    gains = [0.0 if c < FOLLOWED else 1.0 - c / b for b, c in zip(before, costs, strict=True)]
    return problem, gains


def _best_amounts(segment: Segment, residual: Array, columns: Array, room: Array) -> Array:
    """Returns the amounts of all steps of an initial state that leave least, shape (S,).

    Arguments as of `rung`, but all of them: the columns of links first.
    """
    links, motors = np.split(columns, [columns.shape[1] - room.shape[1]], axis=1)
    basis = orthonormal(links)
    motor_amounts = np.zeros(0)
    if room.size:
        motor_amounts = rung(segment, without(residual, basis), without(motors, basis), room)
    own = np.linalg.lstsq(links, -residual - motors @ motor_amounts, rcond=1e-6)[0]
    return np.concatenate([own, motor_amounts])


def with_state_basis(problem: R, effects: Sequence[EffectInstance] = ()) -> R:
    """Returns the problem with what each initial state can explain, to first order."""
    columns = state_columns(problem, effects, state_steps(len(problem.joints)))
    return replace(problem, state_basis=tuple(orthonormal(c) for c in columns))


def state_steps(joints: int, ringing: Sequence[Spring] = ()) -> Array:
    """Returns small changes of positions and velocities, one by one, shape (2 J + 2 M, 4, J).

    Then of motors' states beside their links'.
    """
    each = np.diag(np.repeat((*STATE_STEP, *STATE_STEP), joints)).reshape(-1, 4, joints)
    motors = [side * joints + one.joint for side in (2, 3) for one in ringing]
    return each[[*range(2 * joints), *motors]]


def state_columns(
    problem: Rollouts, effects: Sequence[EffectInstance], steps: Array
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


def _whitened(problem: Rollouts, effects: Sequence[EffectInstance]) -> list[Array]:
    return problem.whitened(problem.predictions([effects])[0])


def _moved(segment: Segment, change: Array) -> Segment:
    """Returns a segment that begins elsewhere, see `state_columns`, shape (4, J)."""
    motor = change[2:] if segment.initial_motor is None else segment.initial_motor + change[2:]
    return replace(
        segment,
        initial_position=segment.initial_position + change[0],
        initial_velocity=segment.initial_velocity + change[1],
        initial_motor=motor,
        measured=segment.measured or segment,
    )


def orthonormal(columns: Array) -> Array:
    """Returns an orthonormal basis of the columns, without directions that are numerical noise.

    A column is nothing where an initial state changes nothing: where a simulation ran away.
    """
    sizes = np.linalg.norm(columns, axis=0)
    acting = sizes > 0.0
    if not acting.any():
        return columns[:, :0]
    left, shares, _ = np.linalg.svd(columns[:, acting] / sizes[acting], full_matrices=False)
    return np.asarray(left[:, shares > 1e-3 * shares[0]])
