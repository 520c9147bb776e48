"""Writes what rlax and Acme say about random MPO and Retrace problems, for the tests of gfm.rl.

Needs an environment of its own, without torch and without this project:

    python3.11 -m venv oracles && oracles/bin/pip install rlax==0.1.9
    pip download --no-deps --no-binary :all: dm-acme==0.4.0 && tar xzf dm-acme-0.4.0.tar.gz
    oracles/bin/python benchmarks/oracles/make_mpo_fixtures.py \
        --acme dm-acme-0.4.0/acme/jax/losses/mpo.py --out tests/data/mpo_oracle.npz

Everything is float64. Problems of one shape are stacked; the first axis counts them.
Shape letters: P problems, N sampled actions, B states, D action size, K transitions.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import json
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import rlax

jax.config.update("jax_enable_x64", val=True)

SEED = 20190101
LIMITS = {
    "epsilon": 0.1,
    "epsilon_penalty": 1e-3,
    "epsilon_mean": 2.5e-3,
    "epsilon_stddev": 1e-6,
}
MPO_SHAPES = [(12, 5, 7), (5, 3, 1), (1, 4, 3), (8, 1, 2)]  # N, B, D
MPO_CASES = ["plain", "one_hot_q", "no_kl", "stiff_alpha", "floor_duals", "far_actions"]
MPO_PER_CASE = 5
RETRACE_LENGTHS = [1, 2, 8, 16]
RETRACE_LAMBDAS = [0.0, 0.95, 1.0]
RETRACE_CASES = ["plain", "terminals", "rho_zero", "rho_one", "rho_huge"]
RETRACE_PER_CASE = 2


def mpo_problem(rng: np.random.Generator, shape: tuple[int, int, int], case: str) -> dict:
    """Returns one random problem with the edge that `case` names."""
    samples, states, size = shape
    problem = {
        "online_mean": rng.normal(0.0, 0.7, (states, size)),
        "online_stddev": rng.uniform(0.05, 1.5, (states, size)),
        "target_mean": rng.normal(0.0, 0.7, (states, size)),
        "target_stddev": rng.uniform(0.05, 1.5, (states, size)),
        "q": rng.normal(0.0, 10.0 ** rng.uniform(-2, 2), (samples, states)),
        "log_temperature": rng.uniform(-2.0, 12.0),
        "log_penalty_temperature": rng.uniform(-2.0, 12.0),
        "log_alpha_mean": rng.uniform(-2.0, 25.0, size),
        "log_alpha_stddev": rng.uniform(-2.0, 25.0, size),
    }
    if case == "one_hot_q":
        problem["q"] = np.eye(samples)[rng.integers(samples, size=states)].T * 1e3
        problem["log_temperature"] = -18.0
    elif case == "no_kl":
        problem["online_mean"] = problem["target_mean"].copy()
        problem["online_stddev"] = problem["target_stddev"].copy()
    elif case == "stiff_alpha":
        problem["log_alpha_mean"] = np.full(size, 10.0)
        problem["log_alpha_stddev"] = np.full(size, 1000.0)
    elif case == "floor_duals":
        for name in ("log_temperature", "log_penalty_temperature"):
            problem[name] = -18.0
        problem["log_alpha_mean"] = np.full(size, -18.0)
        problem["log_alpha_stddev"] = np.full(size, -18.0)
    noise = rng.normal(size=(samples, states, size))
    spread = 6.0 if case == "far_actions" else 1.0
    problem["actions"] = problem["target_mean"] + spread * problem["target_stddev"] * noise
    return problem


def rlax_loss(parameters: dict, problem: dict, *, per_dimension: bool) -> jax.Array:
    """Returns rlax's loss per state (B,) for the decoupled update, in one call."""

    def log_prob(mean: jax.Array, stddev: jax.Array) -> jax.Array:
        scaled = (problem["actions"] - mean) / stddev
        density = -0.5 * scaled**2 - jnp.log(stddev) - 0.5 * jnp.log(2 * jnp.pi)
        return density.sum(-1)

    def dual(name: str) -> jax.Array:
        return jax.nn.softplus(parameters[name]) + 1e-8

    mean, stddev = parameters["online_mean"], parameters["online_stddev"]
    old_mean, old_stddev = problem["target_mean"], problem["target_stddev"]
    kl_mean = (mean - old_mean) ** 2 / (2 * old_stddev**2)
    kl_stddev = jnp.log(stddev / old_stddev) + old_stddev**2 / (2 * stddev**2) - 0.5
    if not per_dimension:
        kl_mean, kl_stddev = kl_mean.sum(-1), kl_stddev.sum(-1)

    def constraint(kl: jax.Array, name: str, epsilon: float) -> tuple:
        alpha = dual(name) if per_dimension else dual(name)[0]
        return kl, rlax.LagrangePenalty(alpha, jnp.array(epsilon), per_dimension=per_dimension)

    loss, _ = rlax.mpo_loss(
        sample_log_probs=log_prob(mean, old_stddev) + log_prob(old_mean, stddev),
        sample_q_values=problem["q"],
        temperature_constraint=rlax.LagrangePenalty(
            dual("log_temperature"), jnp.array(LIMITS["epsilon"])
        ),
        kl_constraints=[
            constraint(kl_mean, "log_alpha_mean", LIMITS["epsilon_mean"]),
            constraint(kl_stddev, "log_alpha_stddev", LIMITS["epsilon_stddev"]),
        ],
    )
    return loss


def acme_loss(parameters: dict, problem: dict, acme: object, *, per_dimension: bool) -> jax.Array:
    """Returns Acme's loss, shape (), with its action penalty."""
    import tensorflow_probability.substrates.jax.distributions as tfd

    mpo = acme.MPO(
        **LIMITS,
        init_log_temperature=0.0,
        init_log_alpha_mean=0.0,
        init_log_alpha_stddev=0.0,
        per_dim_constraining=per_dimension,
        action_penalization=True,
    )
    duals = acme.MPOParams(
        log_temperature=parameters["log_temperature"][None],
        log_alpha_mean=parameters["log_alpha_mean"],
        log_alpha_stddev=parameters["log_alpha_stddev"],
        log_penalty_temperature=parameters["log_penalty_temperature"][None],
    )

    def gaussian(mean: jax.Array, stddev: jax.Array) -> object:
        return tfd.Independent(tfd.Normal(mean, stddev), reinterpreted_batch_ndims=1)

    loss, _ = mpo(
        duals,
        gaussian(parameters["online_mean"], parameters["online_stddev"]),
        gaussian(problem["target_mean"], problem["target_stddev"]),
        problem["actions"],
        problem["q"],
    )
    return loss.reshape(())


TRAINED = ("online_mean", "online_stddev", "log_temperature", "log_penalty_temperature",
           "log_alpha_mean", "log_alpha_stddev")  # fmt: skip


def solve_mpo(problem: dict, acme: object, *, per_dimension: bool) -> dict:
    """Returns both oracles' values and gradients for one problem."""
    problem = {name: jnp.asarray(value, jnp.float64) for name, value in problem.items()}
    parameters = {name: problem[name] for name in TRAINED}

    def rlax_mean(parameters: dict) -> jax.Array:
        return rlax_loss(parameters, problem, per_dimension=per_dimension).mean()

    def acme_mean(parameters: dict) -> jax.Array:
        return acme_loss(parameters, problem, acme, per_dimension=per_dimension)

    solved = {"rlax_loss": rlax_loss(parameters, problem, per_dimension=per_dimension)}
    for oracle, mean in (("rlax", rlax_mean), ("acme", acme_mean)):
        value, gradients = jax.value_and_grad(mean)(parameters)
        solved[f"{oracle}_mean"] = value
        solved |= {f"{oracle}_grad_{name}": value for name, value in gradients.items()}
    return {name: np.asarray(value) for name, value in solved.items()}


def retrace_problem(rng: np.random.Generator, length: int, case: str, lambda_: float) -> dict:
    """Returns one random sequence with the edge that `case` names."""
    discount = rng.uniform(0.9, 1.0, length)
    if case == "terminals":
        discount[rng.uniform(size=length) < 0.3] = 0.0
        discount[rng.integers(length)] = 0.0
    log_rho = {"rho_zero": -1e4, "rho_one": 0.0, "rho_huge": 50.0}.get(case)
    return {
        "q_tm1": rng.normal(size=length),
        "q_t": rng.normal(size=length - 1),
        "v_t": rng.normal(size=length),
        "r_t": rng.normal(size=length),
        "discount_t": discount,
        "log_rho_t": (
            rng.normal(0.0, 1.0, length - 1) if log_rho is None else np.full(length - 1, log_rho)
        ),
        "lambda": np.float64(lambda_),
        "weight": rng.normal(size=length),
    }


def solve_retrace(problem: dict) -> dict:
    """Returns rlax's errors and the gradient of their weighted sum through the targets."""
    traced = ("q_tm1", "q_t", "v_t", "r_t", "discount_t", "log_rho_t")

    def errors(arguments: dict) -> jax.Array:
        return rlax.retrace_continuous(
            *(arguments[name] for name in traced), problem["lambda"], stop_target_gradients=False
        )

    arguments = {name: jnp.asarray(problem[name]) for name in traced}
    gradients = jax.grad(lambda given: jnp.sum(problem["weight"] * errors(given)))(arguments)
    solved = {"error": errors(arguments)}
    solved |= {f"grad_{name}": value for name, value in gradients.items()}
    return {name: np.asarray(value) for name, value in solved.items()}


def stacked(problems: list[dict]) -> dict[str, np.ndarray]:
    """Returns one array per name, the problems along the first axis."""
    return {name: np.stack([problem[name] for problem in problems]) for name in problems[0]}


def mpo_arrays(rng: np.random.Generator, acme: object) -> dict[str, np.ndarray]:
    """Returns all MPO problems with their solutions, by shape and kind of constraint."""
    arrays = {}
    for shape in MPO_SHAPES:
        for per_dimension in (True, False):
            problems = []
            for case in MPO_CASES * (MPO_PER_CASE if per_dimension else 1):
                problem = mpo_problem(rng, shape, case)
                if not per_dimension:
                    for name in ("log_alpha_mean", "log_alpha_stddev"):
                        problem[name] = problem[name][:1]
                problems.append(problem | solve_mpo(problem, acme, per_dimension=per_dimension))
            group = f"mpo/{'x'.join(map(str, shape))}/{'each' if per_dimension else 'joint'}"
            arrays |= {f"{group}/{name}": value for name, value in stacked(problems).items()}
    return arrays


def retrace_arrays(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Returns all Retrace problems with their solutions, by length."""
    arrays = {}
    for length in RETRACE_LENGTHS:
        problems = []
        for case in RETRACE_CASES * RETRACE_PER_CASE:
            for lambda_ in RETRACE_LAMBDAS:
                problem = retrace_problem(rng, length, case, lambda_)
                problems.append(problem | solve_retrace(problem))
        arrays |= {f"retrace/{length}/{name}": value for name, value in stacked(problems).items()}
    return arrays


def main() -> None:
    """Writes the fixtures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--acme", type=Path, required=True, help="Acme's jax/losses/mpo.py")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    spec = importlib.util.spec_from_file_location("acme_mpo", options.acme)
    acme = importlib.util.module_from_spec(spec)
    sys.modules["acme_mpo"] = acme
    spec.loader.exec_module(acme)

    rng = np.random.default_rng(SEED)
    made_by = {
        "script": "benchmarks/oracles/make_mpo_fixtures.py",
        "seed": SEED,
        "limits": LIMITS,
        "acme": "dm-acme 0.4.0, acme/jax/losses/mpo.py",
        **{name: importlib.metadata.version(name) for name in ("rlax", "jax", "numpy")},
        "tfp-nightly": importlib.metadata.version("tfp-nightly"),
    }
    arrays = mpo_arrays(rng, acme) | retrace_arrays(rng)
    np.savez_compressed(options.out, made_by=np.array(json.dumps(made_by)), **arrays)


if __name__ == "__main__":
    main()
