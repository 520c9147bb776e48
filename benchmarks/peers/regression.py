"""Sparse regression of the torque that the model lacks on a library of terms (PySINDy 2.1).

The torque is inverse dynamics along smoothed positions minus what the drives gave. STLSQ drops
terms below a threshold that is chosen by BIC; FROLS adds terms until BIC stops it.

Shape letters: S samples, K terms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from pysindy.optimizers import FROLS, STLSQ

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.signals.smoothing import smooth_states
from gfm.signals.torque_domain import torque_views
from gfm.signals.torques import TorqueView
from gfm.sim.plant import make_plant
from peers.case import Case, Named

#: Speed over which a measured sign passes through zero, rad/s.
_WIDTH = 0.01
#: Ridge per sample: without it, terms that cancel (gain against all inertia) win.
_RIDGE = 0.05
_THRESHOLDS = np.geomspace(1e-3, 1.0, 16)
_MOST_TERMS = 6
_SAMPLES = 6000
#: Part of the largest torque per tilt that another column must reach.
_LEAST_TILT = 0.02
_ORDERS = (4, 6, 7, 8, 12, 14, 20)


@dataclass(frozen=True, kw_only=True, eq=False)
class Term:
    """A column of the library, and what its coefficient means.

    Attributes:
        effect: The effect that it stands for.
        joints: On which.
        column: Torque per unit of the coefficient, N m, shape (S,).
        parameters: What a coefficient says.
    """

    effect: str
    joints: tuple[str, ...]
    column: Array
    parameters: Callable[[float], dict[str, float]]


Select = Callable[[Array, Array], Array]


def stlsq(case: Case) -> tuple[list[Named], float]:
    """Returns what sequentially thresholded least squares names, and the held-out error."""
    return _regress(case, _thresholded)


def frols(case: Case) -> tuple[list[Named], float]:
    """Returns what forward regression with orthogonal least squares names."""
    return _regress(case, _forward)


def _regress(case: Case, select: Select) -> tuple[list[Named], float]:
    views = [
        _evenly_smooth(view, recording)
        for view, recording in zip(
            torque_views(case.problem, case.training), case.training, strict=True
        )
    ]
    shared = _shared_columns(case, views)
    by_joint = [_named(case, views, shared, j, select) for j in range(len(case.joints))]
    best = max(by_joint, key=lambda named: max((n.weight for n in named), default=0.0))
    named = sorted(best, key=lambda one: -one.weight)
    # Only the strongest of each effect, and what can be put into a model.
    first = list({(n.effect, n.joints): n for n in reversed(named)}.values())[::-1]
    instances = [n.instance for n in first if n.instance is not None]
    return first, case.held_out_error(case.specs, instances)


def _evenly_smooth(view: TorqueView, recording: Trajectory) -> TorqueView:
    """Returns the view with its drive as smooth as the accelerations: steps would be errors."""
    drive = smooth_states(recording.time_s, view.drive)[0]
    return replace(view, drive=drive, missing=view.missing + view.drive - drive)


def _named(
    case: Case, views: Sequence[TorqueView], shared: Sequence[Array], joint: int, select: Select
) -> list[Named]:
    """Returns the terms chosen for one joint; weighed by variance explained, over the noise."""
    terms = _terms(case, views, shared, joint)
    missing = np.concatenate([view.missing[:, joint] for view in views])
    columns = np.stack([term.column for term in terms], axis=1)
    thin = slice(None, None, max(len(missing) // _SAMPLES, 1))
    columns, missing = columns[thin], missing[thin]
    scale = np.sqrt(np.mean(columns**2, axis=0))
    # What hardly acts at all (gravity tilted out of an arm's plane) is no term.
    acting = scale > 0.0
    terms = [term for term, acts in zip(terms, acting, strict=True) if acts]
    columns, scale = columns[:, acting], scale[acting]
    coefficients = select(columns / scale, missing / missing.std()) * missing.std() / scale
    noise = max(float(np.std(np.diff(missing)) / np.sqrt(2)), 1e-9)
    return [
        Named(
            effect=term.effect,
            joints=term.joints,
            parameters=term.parameters(float(c)),
            weight=float(np.std(c * column) / noise),
        )
        for term, c, column in zip(terms, coefficients, columns.T, strict=True)
        if c != 0.0
    ]


def _thresholded(columns: Array, target: Array) -> Array:
    fits = []
    for threshold in _THRESHOLDS:
        try:
            optimizer = STLSQ(threshold=threshold, alpha=_RIDGE * len(target))
            fits.append(_coefficients(optimizer, columns, target))
        except ValueError:  # nothing is above the threshold
            break
    return _by_bic(fits, columns, target)


def _forward(columns: Array, target: Array) -> Array:
    optimizer = FROLS(max_iter=_MOST_TERMS)
    optimizer.fit(columns, target[:, None])
    return _by_bic([np.ravel(c) for c in optimizer.history_], columns, target)


def _coefficients(optimizer: STLSQ, columns: Array, target: Array) -> Array:
    optimizer.fit(columns, target[:, None])
    return np.asarray(optimizer.coef_).ravel()


def _by_bic(fits: Sequence[Array], columns: Array, target: Array) -> Array:
    """Returns the coefficients with the least Bayesian information criterion."""
    candidates = [np.zeros(columns.shape[1]), *fits]
    count = len(target)
    scores = [
        count * np.log(np.mean((target - columns @ c) ** 2)) + np.count_nonzero(c) * np.log(count)
        for c in candidates
    ]
    return candidates[int(np.argmin(scores))]


def _terms(
    case: Case, views: Sequence[TorqueView], shared: Sequence[Array], joint: int
) -> list[Term]:
    """Returns the library for one joint."""
    names = case.joints
    q, v, drive = (
        np.concatenate([getattr(view, what)[:, joint] for view in views])
        for what in ("position", "velocity", "drive")
    )
    sign, here = np.tanh(v / _WIDTH), (names[joint],)

    def term(effect: str, column: Array, *parameters: str) -> Term:
        return Term(
            effect=effect,
            joints=here,
            column=column,
            parameters=lambda c: dict.fromkeys(parameters, c),
        )

    pace = float(np.sqrt(np.mean(v**2)))
    made = [
        term("coulomb_friction", -sign, "torque"),
        term("viscous_friction", -v, "coefficient"),
        term("quadratic_drag", -v * np.abs(v), "coefficient"),
        term("torque_offset", np.ones_like(v), "torque"),
        term("load_dependent_friction", -np.abs(drive) * sign, "coefficient"),
        term("joint_spring", -q, "stiffness"),
        *(_stribeck(here, v, sign, share * pace) for share in (0.05, 0.15, 0.4)),
        *(t for order in _ORDERS for t in _cogging(here, q, order)),
        Term(
            effect="actuator_gain",
            joints=here,
            column=drive,
            parameters=lambda c: {"scale": 1.0 + c},
        ),
        Term(
            effect="command_delay",
            joints=names,
            column=-_rate(case, views, joint),
            parameters=lambda c: {"delay": c},
        ),
        Term(
            effect="gravity_direction",
            joints=(),
            column=shared[1][:, joint],
            parameters=lambda c: {"tilt_x": c, "tilt_y": 0.0},
        ),
        Term(
            effect="gravity_direction",
            joints=(),
            column=shared[2][:, joint],
            parameters=lambda c: {"tilt_x": 0.0, "tilt_y": c},
        ),
        Term(
            effect="payload",
            joints=names[-1:],
            column=shared[3][:, joint],
            parameters=lambda c: {"mass": c},
        ),
        term("armature", -shared[0][:, joint], "inertia"),
    ]
    for other in range(len(names)):
        if other != joint:
            apart = v - np.concatenate([view.velocity[:, other] for view in views])
            pair = (names[min(joint, other)], names[max(joint, other)])
            drag = Term(
                effect="coupled_friction",
                joints=pair,
                column=-apart,
                parameters=lambda c: {"viscous": c},
            )
            made.append(drag)
    return made


def _stribeck(here: tuple[str, ...], v: Array, sign: Array, speed: float) -> Term:
    return Term(
        effect="stribeck_friction",
        joints=here,
        column=-np.exp(-((v / speed) ** 2)) * sign,
        parameters=lambda c: {"static_excess": c, "stribeck_velocity": speed},
    )


def _cogging(here: tuple[str, ...], q: Array, order: int) -> list[Term]:
    def parameters(phase: float) -> Callable[[float], dict[str, float]]:
        return lambda c: {"amplitude": c, "per_revolution": float(order), "phase": phase}

    return [
        Term(
            effect="cogging_torque",
            joints=here,
            column=np.sin(order * q + phase),
            parameters=parameters(phase),
        )
        for phase in (0.0, np.pi / 2)
    ]


def _rate(case: Case, views: Sequence[TorqueView], joint: int) -> Array:
    """Returns the rate of change of the drive's torque, N m/s, shape (S,)."""
    return np.concatenate(
        [
            np.gradient(view.drive[:, joint], recording.time_s)
            for view, recording in zip(views, case.training, strict=True)
        ]
    )


def _shared_columns(case: Case, views: Sequence[TorqueView]) -> list[Array]:
    """Returns acceleration, and missing torque per rad of tilt in x and y and per kg of payload.

    Each of shape (S, J): what the model's own inverse dynamics says.
    """
    spec = next(iter(case.specs.values()))
    nominal, (tilt_x, tilt_y), loaded = _changed_models(spec, case.joints)
    parts: list[list[Array]] = [[], [], [], []]
    for view, recording in zip(views, case.training, strict=True):
        acceleration = np.gradient(view.velocity, recording.time_s, axis=0)
        base = _needed(nominal, view, acceleration)
        parts[0].append(acceleration)
        for i, (model, amount) in enumerate(((tilt_x, 0.01), (tilt_y, 0.01), (loaded, 0.1))):
            # What the changed model needs more is what the nominal one lacks.
            parts[i + 1].append(-(_needed(model, view, acceleration) - base) / amount)
    columns = [np.concatenate(part) for part in parts]
    least = _LEAST_TILT * max(np.abs(columns[1]).max(), np.abs(columns[2]).max())
    return [columns[0], *(np.where(np.abs(c).max(axis=0) > least, c, 0.0) for c in columns[1:])]


def _changed_models(
    spec: mujoco.MjSpec, joints: Sequence[str]
) -> tuple[mujoco.MjModel, tuple[mujoco.MjModel, mujoco.MjModel], mujoco.MjModel]:
    com = dict(zip(("com_x", "com_y", "com_z"), spec.joint(joints[-1]).parent.ipos, strict=True))
    library = {
        "x": ("gravity_direction", (), {"tilt_x": 0.01, "tilt_y": 0.0}),
        "y": ("gravity_direction", (), {"tilt_x": 0.0, "tilt_y": 0.01}),
        "load": (
            "payload",
            tuple(joints[-1:]),
            {"mass": 0.1} | {axis: float(place) for axis, place in com.items()},
        ),
    }
    models = {}
    for key, (effect, where, values) in library.items():
        instance = Named(effect=effect, joints=where, parameters=values, weight=0.0).instance
        models[key] = make_plant(spec, joints, [] if instance is None else [instance]).model
    return make_plant(spec, joints).model, (models["x"], models["y"]), models["load"]


def _needed(model: mujoco.MjModel, view: TorqueView, acceleration: Array) -> Array:
    """Returns inverse dynamics along a motion, N m, shape (S, J); joints in the model's order."""
    data, needed = mujoco.MjData(model), np.empty_like(view.position)
    for i in range(len(needed)):
        data.qpos[:], data.qvel[:] = view.position[i], view.velocity[i]
        data.qacc[:] = acceleration[i]
        mujoco.mj_inverse(model, data)
        needed[i] = data.qfrc_inverse
    return needed
