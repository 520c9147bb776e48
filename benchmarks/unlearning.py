"""Why learning makes a good warm start worse: an experiment for each suspicion.

    python benchmarks/unlearning.py --out runs/unlearning

On the recordings of `fit_forces.py`, a warm start is made for several sizes of the noise that
explores, to which the reward's scale belongs. Its reward is measured with that noise and without;
at states along its way one action is changed, there and back, and what that does to the return is
set against what the noise of later actions does. Then only a critic learns, and what it says of
the same actions is compared with what they did. In the end learning goes on as `gfm fit` does.
What is there already is not repeated.

Shape letters: H periods, N states, K pairs of actions, A generalized forces, O observation size.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
import torch
from fit_forces import record, write_models
from parts import Part, commits, done_parts, print_or_write

from gfm.core import EnvironmentSpec, MonotonicClock, Trajectory
from gfm.core.checks import Array, Array32
from gfm.effects import EffectInstance, find_effect
from gfm.envs.fit_problem import FitProblem
from gfm.envs.gfm_fit import GfmFit
from gfm.envs.registry import EnvironmentAssets, fit_problem
from gfm.excitation.motion import Purpose
from gfm.experiments.fit import (
    HORIZON,
    WARM,
    Beginning,
    FitInputs,
    FittedForces,
    ForceFit,
    force_model,
    silent,
    training_error,
)
from gfm.experiments.run import KINDS, nominal_arm
from gfm.launch import Supervisor, own_system, replay_process, router_process
from gfm.recording import read_recording
from gfm.recording.weights_file import read_arrays
from gfm.rl.learner_state import LearnerSettings, Networks
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.rl.regression import RegressionSettings
from gfm.service.assets import load_assets
from gfm.sim.plant import stepping_spec
from gfm.sim.sawyer import READY
from gfm_learner.checkpoint import CHECKPOINT
from gfm_robot_bridge.simulated.hidden import draw

#: Noise on the actions, in units of the forces' limits: as `gfm fit` has it at least, and less.
STDDEVS = (0.05, 0.01, 0.002)
TRAJECTORIES = 5
#: States at which actions are changed, pairs of changes at each, and periods before and after.
STATES, PAIRS, BEFORE, AFTER = 256, 16, 10, 20
#: In which only the critic learns, where it is compared.
_CRITIC_ONLY = 1_000_000
_FORMAT = "gfm.checkpoint/2"

_HEAD = """# Why learning makes a warm start of forces worse

{count} recordings of a simulated Sawyer that hides {effect} (seed {seed}). Written by

    python benchmarks/unlearning.py {flags} --effect {effect} --seed {seed}

at {commit}. "Noise" is the standard deviation of each action, in units of the force's limit; the
reward's scale belongs to it, so that noise alone costs about as much reward in every row.
"""


@dataclass(frozen=True, kw_only=True)
class Told:
    """What was measured with one size of the noise.

    Attributes:
        stddev: Of the noise, as it was asked for.
        without: Mean reward of a period without forces.
        true: The same under the model that has what the robot hides: states are measured.
        mean: The same of the warm start, without noise on its actions.
        noisy: With it.
        across: Standard deviation of the return from state to state.
        later: Of the return from one state, by the noise of later actions.
        straight: By the action there: what changes sign with the change.
        bent: And what does not: what any change costs.
        heard: Correlation of what a critic says of the straight part with what it is.
        steps: Learner steps of that critic.
        errors: Training error by learner step, rad: of the warm start first.
        nominal: The same without forces.
        learned: Mean reward of the last policy, without noise on its actions.
        held_out: Errors on recordings that nothing was fitted to, rad: without forces, of the warm
            start, and of the last policy.
    """

    stddev: float
    without: float
    true: float
    mean: float
    noisy: float
    across: float
    later: float
    straight: float
    bent: float
    heard: float
    steps: int
    errors: list[tuple[int, float]]
    nominal: float
    learned: float
    held_out: tuple[float, float, float]


def beginning(stddev: float, critic_first_steps: int) -> Beginning:
    """Returns the warm start with so much noise."""
    regression = RegressionSettings(least_stddev=stddev, greatest_stddev=stddev)
    return replace(WARM, critic_first_steps=critic_first_steps, regression=regression)


def fitted(inputs: FitInputs, minutes: float) -> FittedForces:
    """Returns what comes of so many minutes of learning."""
    inputs.folder.mkdir(parents=True, exist_ok=True)
    fit = ForceFit(inputs, MonotonicClock())
    system = own_system("fit", inputs.folder, (router_process(), replay_process()))
    with Supervisor(system, inputs.folder / "logs") as supervisor:
        supervisor.start()
        fit.start(supervisor)
        fit.follow(supervisor, 60.0 * minutes, lambda words, _: print(words, flush=True))
    return fit.finish()


def true_problem(inputs: FitInputs, problem: FitProblem, effect: str, seed: int) -> FitProblem:
    """Returns a problem under the model that has what the robot hides."""
    names = problem.model.layout.joint_names
    hidden = tuple(
        EffectInstance(
            effect=find_effect(one.effect),
            joints=tuple(names[i] for i in one.joints),
            values=one.parameters,
        )
        for one in draw(effect, seed, READY)
    )
    specs = nominal_arm(()).specs
    assets = EnvironmentAssets(
        models={kind: stepping_spec(specs[kind], hidden).compile() for kind in KINDS},
        effects=hidden,
        trajectories=load_assets(inputs.environment).trajectories,
    )
    settings = msgspec.structs.replace(
        inputs.environment,
        forced_joints=tuple(names[i] for i in problem.model.forced),
        scale=tuple(problem.scale.tolist()),
    )
    return fit_problem(settings, assets)


class Rollouts:
    """Episodes of `gfm_fit` from the same recorded states, again and again."""

    def __init__(self, problem: FitProblem, policy: GaussianPolicy, seed: int) -> None:
        self._problem, self._policy, self._seed = problem, policy, seed

    def rewards(
        self,
        noise: Array,
        *,
        forced: bool = True,
        seen: Callable[[int, Array32, Array32], None] = lambda *_: None,
    ) -> Array:
        """Returns rewards, shape (H, N).

        Args:
            noise: Added to the mean action, shape (H, N, A).
            forced: Whether there are forces at all.
            seen: Told the number of the period, observations and mean actions.
        """
        environment = GfmFit(self._problem, noise.shape[1], seed=self._seed)
        observation = environment.reset()
        rows = []
        for period, more in enumerate(noise):
            mean = self._policy.mean_action(observation[:, : self._policy.observation_size])
            seen(period, observation, mean)
            action = np.clip(mean + more, -1.0, 1.0).astype(np.float32) * forced
            told = environment.step(action)
            observation = told.observation
            rows.append(told.reward)
        return np.array(rows, np.float64)


def changed(
    rollouts: Rollouts, shape: tuple[int, ...], stddev: float, discount: float
) -> tuple[Array, Array, Array]:
    """Returns what changes of one action do to the return, there and back.

    Changes, shape (K, N, A), and returns with them and with their opposites, shape (K, N) each.
    """
    rng = np.random.default_rng(1)
    weights = discount ** np.arange(AFTER)
    changes = rng.standard_normal((PAIRS, *shape)) * stddev

    def returned(change: Array) -> Array:
        noise = np.zeros((BEFORE + AFTER, *shape))
        noise[BEFORE] = change
        return np.asarray(weights @ rollouts.rewards(noise)[BEFORE:])

    both = [(returned(one), returned(-one)) for one in changes]
    there, back = map(np.stack, zip(*both, strict=True))
    return changes, there, back


def split(there: Array, back: Array) -> tuple[Array, Array]:
    """Returns what of returns (K, N) changes sign with a change, and what else it does, (K, N)."""
    both = 0.5 * (there + back)
    return 0.5 * (there - back), both - both.mean(axis=0)


def noisy_returns(
    rollouts: Rollouts, shape: tuple[int, ...], stddev: float, discount: float
) -> Array:
    """Returns returns from the same states under noise of later actions, shape (K, N)."""
    rng = np.random.default_rng(2)
    weights = discount ** np.arange(AFTER)
    rows = []
    for _ in range(PAIRS):
        noise = rng.standard_normal((BEFORE + AFTER, *shape)) * stddev
        noise[: BEFORE + 1] = 0.0
        rows.append(weights @ rollouts.rewards(noise)[BEFORE:])
    return np.stack(rows)


def critic_of(folder: Path, spec: EnvironmentSpec) -> tuple[Networks, int]:
    """Returns the networks of a run's newest checkpoint, and their learner step."""
    meta, arrays = read_arrays(folder / CHECKPOINT, _FORMAT)
    networks = Networks(spec, LearnerSettings())
    own = {k.removeprefix("networks/"): v for k, v in arrays.items() if k.startswith("networks/")}
    networks.load_state_dict({name: torch.tensor(array) for name, array in own.items()})
    return networks, int(meta["steps"])


@torch.no_grad()
def says(networks: Networks, observation: Array32, actions: Array) -> Array:
    """Returns what a critic says of actions (K, N, A) at observations (N, O), shape (K, N)."""
    _, seen = networks.normalise(torch.tensor(observation), update=False)
    return np.asarray(networks.critic(seen, torch.tensor(actions, dtype=torch.float32)).numpy())


def measure(
    inputs: FitInputs,
    held_out: Sequence[Trajectory],
    effect: str,
    stddev: float,
    minutes: float,
    critic_minutes: float,
) -> Told:
    """Makes the warm start with one size of the noise, and measures all that is asked of it."""
    critic, learning = (
        replace(inputs, folder=inputs.folder / name, began=beginning(stddev, waited))
        for name, waited in (("critic", _CRITIC_ONLY), ("learning", WARM.critic_first_steps))
    )
    only, learned = fitted(critic, critic_minutes), fitted(learning, minutes)
    problem = only.problem
    first = GaussianPolicy.from_weights(only.snapshots[0].weights)
    last = GaussianPolicy.from_weights(learned.snapshots[-1].weights)
    warm, after = (Rollouts(problem, one, inputs.seed) for one in (first, last))
    right = Rollouts(true_problem(inputs, problem, effect, inputs.seed), first, inputs.seed)
    networks, steps = critic_of(critic.folder, GfmFit(problem, 1, seed=0).spec)
    none = np.zeros((HORIZON, STATES, problem.action_size))
    noise = np.random.default_rng(3).standard_normal(none.shape) * stddev
    return Told(
        stddev=stddev,
        without=float(warm.rewards(none, forced=False).mean()),
        true=float(right.rewards(none, forced=False).mean()),
        mean=float(warm.rewards(none).mean()),
        noisy=float(warm.rewards(noise).mean()),
        learned=float(after.rewards(none).mean()),
        **of_one_action(warm, networks, none.shape[1:], stddev),
        steps=steps,
        errors=[(one.weights.version, one.error) for one in learned.snapshots],
        nominal=learned.nominal_error,
        held_out=errors_held_out(learned, held_out),
    )


def of_one_action(
    warm: Rollouts, networks: Networks, shape: tuple[int, ...], stddev: float
) -> dict[str, float]:
    """Returns what one action does to a return beside all else, and what a critic hears of it."""
    discount, kept = LearnerSettings().discount, dict[str, Array32]()

    def keep(period: int, observation: Array32, mean: Array32) -> None:
        if period == BEFORE:
            kept.update(observation=observation, mean=mean)

    rewards = warm.rewards(np.zeros((BEFORE + AFTER, *shape)), seen=keep)
    changes, there, back = changed(warm, shape, stddev, discount)
    straight, bent = split(there, back)
    at = [says(networks, kept["observation"], kept["mean"] + sign * changes) for sign in (1, -1)]
    said, _ = split(*at)
    return {
        "across": float((discount ** np.arange(AFTER) @ rewards[BEFORE:]).std()),
        "later": float(noisy_returns(warm, shape, stddev, discount).std(axis=0).mean()),
        "straight": float(np.sqrt(np.mean(straight**2))),
        "bent": float(np.sqrt(np.mean(bent**2))),
        "heard": float(np.corrcoef(straight.ravel(), said.ravel())[0, 1]),
    }


def errors_held_out(
    learned: FittedForces, held_out: Sequence[Trajectory]
) -> tuple[float, float, float]:
    """Returns errors without forces, of the warm start, and of the last policy, rad."""
    first, last = (one.weights for one in (learned.snapshots[0], learned.snapshots[-1]))
    models = [force_model(learned.problem, one) for one in (silent(first), first, last)]
    without, warm, after = (training_error(one, held_out) for one in models)
    return without, warm, after


def page(rows: list[Told]) -> Iterator[str]:
    """Yields the lines of the tables."""
    yield "| noise | reward without forces | warm start | the same with the noise | the truth |"
    yield "|---|---|---|---|---|"
    for one in rows:
        told = f"{one.without:.3f} | {one.mean:.4f} | {one.noisy:.3f} | {one.true:.4f}"
        yield f"| {one.stddev:g} | {told} |"
    yield ""
    yield (
        "| noise | return, from state to state | by the noise of later actions | by one action: "
        "with its sign | whatever its sign | what the critic hears of the former |"
    )
    yield "|---|---|---|---|---|---|"
    for one in rows:
        yield (
            f"| {one.stddev:g} | {one.across:.4f} | {one.later:.4f} | {one.straight:.4f} "
            f"| {one.bent:.4f} | {one.heard:.2f} ({one.steps} steps) |"
        )
    yield ""
    yield (
        "| noise | error, mrad, of | without forces | warm start | best after learning | last "
        "| reward of warm start and last |"
    )
    yield "|---|---|---|---|---|---|---|"
    for one in rows:
        first, *rest = [error for _, error in one.errors]
        later = [e for step, e in one.errors if step > WARM.critic_first_steps] or rest
        told = (one.nominal, first, min(later), later[-1])
        cells = " | ".join(f"{1e3 * error:.3f}" for error in told)
        reward = f"{one.mean:.4f}, {one.learned:.4f} ({one.errors[-1][0]} steps)"
        yield f"| {one.stddev:g} | what is fitted | {cells} | {reward} |"
        without, warm, last = (f"{1e3 * error:.3f}" for error in one.held_out)
        yield f"| | held out | {without} | {warm} | | {last} | |"


def main() -> None:
    """Records, measures and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs/unlearning"), metavar="DIR")
    parser.add_argument("--effect", default="cogging_torque")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=4.0, help="of learning, each")
    parser.add_argument("--critic-minutes", type=float, default=2.0)
    parser.add_argument("--stddev", type=float, action="append")
    parser.add_argument("--page", type=Path, metavar="FILE")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    paths = record(asked.out, asked.effect, asked.seed)
    held_out = [read_recording(Path(path)) for path in paths[Purpose.HELDOUT]]
    models = dict(zip(KINDS, write_models(asked.out / "models"), strict=True))
    stddevs = {f"noise_{one:g}": one for one in asked.stddev or STDDEVS}

    def made(name: str) -> Part:
        inputs = FitInputs(
            models=models,
            recordings=tuple(map(Path, paths[Purpose.TRAINING][:TRAJECTORIES])),
            folder=asked.out / name,
            seed=asked.seed,
            actors=1,
        )
        return asdict(
            measure(
                inputs,
                held_out,
                asked.effect,
                stddevs[name],
                asked.minutes,
                asked.critic_minutes,
            )
        )

    parts = done_parts(asked.out, list(stddevs), made)
    rows = [Told(**{k: v for k, v in part.items() if k != "commit"}) for part in parts.values()]
    flags = f"--minutes {asked.minutes:g} --critic-minutes {asked.critic_minutes:g}"
    head = _HEAD.format(
        flags=" ".join([flags, *(f"--stddev {one:g}" for one in stddevs.values())]),
        effect=asked.effect,
        seed=asked.seed,
        count=TRAJECTORIES,
        commit=commits(parts),
    )
    print_or_write("\n".join([head, *page(rows), ""]), asked.page)


if __name__ == "__main__":
    main()
