"""Where a fit of generalized forces begins: which joints, how strong, what they depend on.

Forces by inverse dynamics along the training recordings are regressed onto the policy network.
Joints that the nominal model predicts down to the noise get none. Where there is a free object, it
alone gets some: inverse dynamics tell wrongly what contacts do (94 N m were missing on an arm that
lacks nothing), and its forces are found by short rollouts instead (`gfm.envs.object_forces`). What
each force may depend on, and how smooth it is, are chosen by training recordings that the
regression has not seen: by predicting their missing forces, and by rolling them out. To begin with,
forces depend mostly on the joint's own motion and drive, for the motions of the others in a few
recordings are enough to explain anything with. Dry friction has to change sharply with speed; what
changes with the angle, as cogging does, does better on other motions when it is smooth.

Shape letters: J joints, A generalized forces, O observation size, M examples.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from gfm.core import Trajectory
from gfm.core.checks import Array, Array32
from gfm.diagnosis.data.segmentation import measure_noise
from gfm.envs.fit_problem import FitProblem, counted_scale, explored_difference
from gfm.envs.object_forces import object_forces
from gfm.envs.pushes import ObjectErrors, errors_under, make_pushes, object_errors
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings, fit_problem
from gfm.envs.warm_start import example_states, warm_start_examples
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.rl.regression import Mask, RegressionSettings, fit_policy
from gfm.signals.object_track import plane_noise, track_of
from gfm.sim.hybrid import HybridModel
from gfm.sim.residual import residual_forces
from gfm.sim.rollout import rollout_errors

#: A joint gets forces where the nominal model errs by more than so many times the noise: the
#: initial state of a rollout is measured, too, and joints move each other.
_ABOVE_NOISE = 2.0
#: Limits leave so much room above what (almost) all recorded states ask for.
_ROOM, _QUANTILE = 1.2, 0.995
#: The reward falls to exp(-1) so many times as far off as a policy's own noise would lead.
_SPREAD = 2.0
#: Groups of recordings that are left out in turn.
_FOLDS = 3
_TRIAL_SHARE = 0.25  # of the epochs, for those fits
#: Noise on scaled inputs and decay of weights between which is chosen.
_SMOOTHINGS = ((0.0, 0.0), (0.1, 0.0), (0.05, 1.0))
#: Forces on a free object, the last of all.
_ON_OBJECT = 6


@dataclass(frozen=True, kw_only=True)
class WarmStart:
    """The first policy and the problem that it was made for.

    Attributes:
        settings: Of the environment, with the chosen joints and limit.
        problem: The same, loaded.
        tensors: The policy.
        nominal_errors: Training error of every joint without forces, rad, shape (J,).
        object_errors: Of a free object without forces; None where there is none, or it never moves.
        lacking: Whether any of them, or the object's, is more than noise.
        foretells: Whether a regression on some recordings foretells anything of the forces in
            others; true of what could not be tried.
        about: What was chosen, in words with figures.
    """

    settings: EnvironmentSettings
    problem: FitProblem
    tensors: Mapping[str, Array32]
    nominal_errors: Array
    object_errors: ObjectErrors | None
    lacking: bool
    foretells: bool
    about: str


def warm_start(
    settings: EnvironmentSettings,
    assets: EnvironmentAssets,
    seed: int,
    regression: RegressionSettings | None = None,
) -> WarmStart:
    """Returns where to begin with recordings and models.

    Args:
        settings: Period, horizon and least limit of the forces.
        assets: The training recordings and the nominal models.
        seed: Of the regression.
        regression: How to regress; without epochs, the policy is one that has learned nothing.
    """
    recordings = assets.trajectories
    nominal = HybridModel(
        models=assets.models,
        joint_names=recordings[0].joint_names,
        control_period_s=settings.control_period_s,
        effects=assets.effects,
    )
    errors = joint_errors(nominal, recordings)
    forced = np.flatnonzero(errors > _ABOVE_NOISE * measure_noise(recordings).position)
    if nominal.layout.has_object:
        forced = forced[:0]
    forces = _missing_forces(nominal, recordings)
    chosen = _with_forces(settings, nominal, forced, np.concatenate(forces))
    problem = fit_problem(chosen, assets)
    pushes = make_pushes(nominal, recordings) if nominal.layout.has_object else ()
    pushed = object_errors(nominal, pushes) if pushes else None
    lacking = bool(len(forced)) or (pushed is not None and _is_lacking(pushed, recordings))
    columns = np.concatenate([problem.model.forced, len(errors) + np.arange(_on_object(nominal))])
    examples = warm_start_examples(problem, [one[:, columns] for one in forces])
    how = regression or RegressionSettings()
    if not lacking:
        how = msgspec.structs.replace(how, epochs=0)
    tried = how.epochs > 0 and len(recordings) > 1
    best, left = _choose_inputs(problem, examples, how, seed)
    inputs = _candidates(problem)[best]
    if how.epochs:
        how = _choose_smoothing(problem, recordings, examples, how, seed, inputs)
    fitted = fit_policy(*examples, how, seed, inputs)
    scale = _reward_scale(problem, how.least_stddev) if how.epochs else problem.scale
    chosen = msgspec.structs.replace(chosen, scale=tuple(scale.tolist()))
    return WarmStart(
        settings=chosen,
        problem=replace(problem, scale=scale),
        tensors=fitted.tensors,
        nominal_errors=errors,
        object_errors=pushed,
        lacking=lacking,
        foretells=not tried or _share(left, examples[1]) < 1.0,
        about=_about(chosen, best, how, left, examples[1]),
    )


def joint_errors(model: HybridModel, recordings: Sequence[Trajectory]) -> Array:
    """Returns the position RMSE of every joint without forces, in open loop, rad, shape (J,)."""
    errors = np.concatenate(rollout_errors(model, recordings))
    return np.asarray(np.sqrt((errors**2).mean(axis=0)))


def _on_object(model: HybridModel) -> int:
    return _ON_OBJECT if model.layout.has_object else 0


def _missing_forces(model: HybridModel, recordings: Sequence[Trajectory]) -> list[Array]:
    """Returns the forces that the model lacks on its joints, then on the object, (K, A) each."""
    if not model.layout.has_object:
        return [residual_forces(model, one) for one in recordings]
    joints = len(model.forced)
    found = object_forces(model, recordings)
    return [np.hstack([np.zeros((len(one), joints)), one]) for one in found]


def _is_lacking(errors: ObjectErrors, recordings: Sequence[Trajectory]) -> bool:
    """Returns whether an object moves otherwise than a model says, by more than the noise."""
    tracks = [track for one in recordings if (track := track_of(one)) is not None]
    return errors.place_m > _ABOVE_NOISE * float(np.linalg.norm(plane_noise(tracks)[:2]))


def _candidates(problem: FitProblem) -> dict[str, Mask]:
    """Returns what each force may depend on, shape (A, O), by its description.

    Nothing brings an object back to where it was recorded. From earlier states a policy reads how
    it is accelerated, which tells the force in a recording and is its own echo in a rollout: there
    forces die away. So with an object the newest state has to do.
    """
    features, model = problem.features, problem.model
    everything = np.ones((problem.action_size, features.size), bool)
    own = np.array([features.of_joint(joint) for joint in model.forced])
    if model.layout.has_object:
        own = np.vstack([own, np.tile(features.of_object(), (_ON_OBJECT, 1))])
        now = np.tile(features.of_now(), (problem.action_size, 1))
        return {"the newest state of what it acts on": own & now, "the newest state of all": now}
    newest = np.arange(features.size) < len(model.layout.joint_names)
    return {
        "its joint's states and drive": own,
        "its joint's states and drive and the pose": own | newest,
        "everything observed": everything,
    }


def _with_forces(
    settings: EnvironmentSettings, model: HybridModel, forced: NDArray[np.intp], force: Array
) -> EnvironmentSettings:
    """Returns the settings with forces on chosen joints and the object, and limits that suit them.

    There has to be a joint: where none is chosen, the first one is, of which nothing is asked.
    """
    needed = np.quantile(np.abs(force), _QUANTILE, axis=0)
    chosen = forced if len(forced) else np.arange(1)
    limits = {"joint_nm": float(np.ceil(_ROOM * needed[chosen].max()))}
    if model.layout.has_object:
        on_object = _ROOM * needed[-_ON_OBJECT:]
        limits |= {"object_n": float(on_object[:3].max()), "object_nm": float(on_object[3:].max())}
    return msgspec.structs.replace(
        settings,
        forced_joints=tuple(model.layout.joint_names[i] for i in chosen),
        **{name: max(getattr(settings, name), limit) for name, limit in limits.items()},
    )


def _reward_scale(problem: FitProblem, stddev: float) -> Array:
    """Returns the scale of what a policy that is nearly right may still get wrong, shape (C,).

    That of the nominal model's error would leave the reward flat about the warm start.
    """
    model, windows = problem.model, problem.windows
    size = _SPREAD * explored_difference(model, windows, problem.horizon, stddev)
    return counted_scale(model, size)


def _choose_inputs(
    problem: FitProblem, examples: tuple[Array32, Array32], how: RegressionSettings, seed: int
) -> tuple[str, Array]:
    """Returns the candidate that predicts best what it has not seen, and its error, (A,)."""
    if not how.epochs:
        needed = np.sqrt(np.square(examples[1], dtype=np.float64).mean(axis=0))
        return list(_candidates(problem))[-1], needed
    left = {
        name: _left_out_rmse(problem, examples, _briefly(how), seed, inputs)
        for name, inputs in _candidates(problem).items()
    }
    best = min(left, key=lambda name: float(np.square(left[name]).sum()))
    return best, left[best]


def _choose_smoothing(
    problem: FitProblem,
    recordings: Sequence[Trajectory],
    examples: tuple[Array32, Array32],
    how: RegressionSettings,
    seed: int,
    inputs: Mask,
) -> RegressionSettings:
    """Returns how to regress so that recordings which are left out are followed best.

    By the mean logarithm of their errors: one of them that runs away would decide everything.
    """
    if len(recordings) == 1:
        return how
    chosen = [
        msgspec.structs.replace(how, input_noise=noise, weight_decay=decay)
        for noise, decay in _SMOOTHINGS
    ]
    errors = []
    for one in chosen:
        followed = [
            followed_rmse(problem, policy, [recordings[i] for i in out])
            for out, policy in _folds(problem, examples, _briefly(one), seed, inputs)
        ]
        errors.append(float(np.log(np.concatenate(followed)).mean()))
    return chosen[int(np.argmin(errors))]


def followed_rmse(
    problem: FitProblem, policy: GaussianPolicy, recordings: Sequence[Trajectory]
) -> Array:
    """Returns how far each recording is followed: an object's place, m, else the joints, rad."""
    if not problem.model.layout.has_object:
        return rollout_rmse(problem, policy, recordings)
    model, all_pushes = problem.model, make_pushes(problem.model, recordings)
    each = [all_pushes.of([i]) for i in np.unique(all_pushes.recording)]
    errors = [errors_under(policy.mean_action, problem.features, model, one) for one in each]
    return np.array([one.place_m for one in errors])


def rollout_rmse(
    problem: FitProblem, policy: GaussianPolicy, recordings: Sequence[Trajectory]
) -> Array:
    """Returns the position RMSE of each recording in open loop with a policy's forces, rad."""
    errors = rollout_errors(
        problem.model, recordings, policy=policy.mean_action, features=problem.features
    )
    return np.array([np.sqrt(np.mean(error**2)) for error in errors])


def _briefly(how: RegressionSettings) -> RegressionSettings:
    return msgspec.structs.replace(how, epochs=max(1, round(_TRIAL_SHARE * how.epochs)))


def _folds(
    problem: FitProblem,
    examples: tuple[Array32, Array32],
    how: RegressionSettings,
    seed: int,
    inputs: Mask,
) -> Iterator[tuple[list[int], GaussianPolicy]]:
    """Yields groups of recordings, each with a policy regressed on the others; none of one."""
    observation, action = examples
    recording = problem.windows.recording[example_states(problem)]
    count = len(problem.windows.models)
    for fold in range(min(_FOLDS, count) if count > 1 else 0):
        others = recording % _FOLDS != fold
        fitted = fit_policy(observation[others], action[others], how, seed, inputs)
        out = list(range(fold, count, _FOLDS))
        yield out, GaussianPolicy.from_weights(fitted.tensors)


def _left_out_rmse(
    problem: FitProblem,
    examples: tuple[Array32, Array32],
    how: RegressionSettings,
    seed: int,
    inputs: Mask,
) -> Array:
    """Returns the error in recordings that nothing was learned from, unit forces, shape (A,)."""
    observation, action = examples
    recording = problem.windows.recording[example_states(problem)]
    error = action.astype(np.float64)
    for out, policy in _folds(problem, examples, how, seed, inputs):
        left = np.isin(recording, out)
        error[left] -= policy.mean_action(observation[left])
    return np.asarray(np.sqrt(np.square(error).mean(axis=0)))


def _about(
    settings: EnvironmentSettings,
    inputs: str,
    how: RegressionSettings,
    left: Array,
    action: Array32,
) -> str:
    on_object = action.shape[1] > len(settings.forced_joints)
    share = _share(left, action)
    smooth = f" (smoothed: input noise {how.input_noise:g}, weight decay {how.weight_decay:g})"
    return (
        f"forces on {_places(settings, on_object)}, every "
        f"{1e3 * settings.control_period_s:g} ms, beginning with {inputs}"
        f"{smooth if how.input_noise or how.weight_decay else ''}; of the missing force "
        f"{share:.0%} remains in recordings left out"
    )


def _share(left: Array, action: Array32) -> float:
    """Returns which share of the missing forces is left in recordings that were left out."""
    rms = np.sqrt(np.square(action, dtype=np.float64).sum(axis=1).mean())
    return float(np.sqrt(np.square(left).sum()) / max(float(rms), 1e-12))


def _places(settings: EnvironmentSettings, on_object: bool) -> str:
    if not on_object:
        return f"{', '.join(settings.forced_joints)}, at most {settings.joint_nm:g} N m"
    return f"the object, at most {settings.object_n:.3g} N and {settings.object_nm:.3g} N m"
