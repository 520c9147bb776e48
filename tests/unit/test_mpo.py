"""MPO: agreement with rlax and Acme in float64, and a bandit with a known optimum."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch

from gfm.core import ShapeError
from gfm.rl.gaussian import Gaussian
from gfm.rl.mpo import Duals, Limits, mpo_loss

FIXTURES = Path(__file__).parents[1] / "data" / "mpo_oracle.npz"
DUALS = ("log_temperature", "log_penalty_temperature", "log_alpha_mean", "log_alpha_stddev")


def load():
    with np.load(FIXTURES, allow_pickle=False) as data:
        return {name: data[name] for name in data.files}


ARRAYS = load()
GROUPS = sorted({name.rsplit("/", 1)[0] for name in ARRAYS if name.startswith("mpo/")})
LIMITS = json.loads(str(ARRAYS["made_by"]))["limits"]


def problems(group):
    names = [name for name in ARRAYS if name.startswith(f"{group}/")]
    count = len(ARRAYS[f"{group}/q"])
    for index in range(count):
        yield {name.rsplit("/", 1)[1]: torch.tensor(ARRAYS[name][index]) for name in names}


def duals_of(problem, limits):
    duals = Duals(problem["online_mean"].shape[-1], limits).double()
    for name in DUALS:
        getattr(duals, name).data.copy_(problem[name])
    return duals


def solve(problem, limits):
    online_mean = problem["online_mean"].clone().requires_grad_()
    online_stddev = problem["online_stddev"].clone().requires_grad_()
    duals = duals_of(problem, limits)
    loss, _ = mpo_loss(
        online=Gaussian(mean=online_mean, stddev=online_stddev),
        target=Gaussian(mean=problem["target_mean"], stddev=problem["target_stddev"]),
        actions=problem["actions"],
        q=problem["q"],
        duals=duals,
        limits=limits,
    )
    loss.mean().backward()
    gradients = {"online_mean": online_mean.grad, "online_stddev": online_stddev.grad}
    for name in DUALS:
        gradient = getattr(duals, name).grad
        gradients[name] = torch.zeros_like(problem[name]) if gradient is None else gradient
    return loss.detach(), gradients


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("oracle", ["rlax", "acme"])
def test_value_and_every_gradient_agree_with(oracle, group):
    limits = Limits(**LIMITS, per_dimension=group.endswith("each"), action_penalty=oracle == "acme")
    for problem in problems(group):
        loss, gradients = solve(problem, limits)
        mean = problem[f"{oracle}_mean"]
        torch.testing.assert_close(loss.mean(), mean, rtol=1e-9, atol=1e-9)
        for name, gradient in gradients.items():
            expected = problem[f"{oracle}_grad_{name}"]
            torch.testing.assert_close(gradient, expected, rtol=1e-9, atol=1e-9, msg=name)


@pytest.mark.parametrize("group", GROUPS)
def test_loss_of_each_state_agrees_with_rlax(group):
    limits = Limits(**LIMITS, per_dimension=group.endswith("each"), action_penalty=False)
    for problem in problems(group):
        loss, _ = solve(problem, limits)
        torch.testing.assert_close(loss, problem["rlax_loss"], rtol=1e-9, atol=1e-9)


def test_fixtures_hold_enough_problems():
    assert sum(len(ARRAYS[f"{group}/q"]) for group in GROUPS) >= 100


def test_duals_are_clamped_whether_or_not_constraints_are_per_dimension():
    for per_dimension in (True, False):
        duals = Duals(3, Limits(per_dimension=per_dimension), log_temperature=-50.0)
        duals.log_alpha_mean.data.fill_(-20.0)
        duals.clamp()
        assert duals.log_temperature.item() == -18.0
        assert duals.log_penalty_temperature.item() == -18.0
        assert (duals.log_alpha_mean == -18.0).all()


def test_q_of_a_wrong_shape_is_named():
    gaussian = Gaussian(mean=torch.zeros(2, 3), stddev=torch.ones(2, 3))
    with pytest.raises(ShapeError, match=r"q has shape \(5, 3\), expected \(5, 2\)"):
        mpo_loss(
            online=gaussian,
            target=gaussian,
            actions=torch.zeros(5, 2, 3),
            q=torch.zeros(5, 3),
            duals=Duals(3, Limits()),
            limits=Limits(),
        )


def test_a_limit_that_is_not_positive_is_refused():
    with pytest.raises(msgspec.ValidationError, match=r"> 0.0 - at `\$.epsilon`"):
        msgspec.convert({"epsilon": 0.0}, Limits)


def bandit(limits, optimum, steps=400):
    """Improves a Gaussian on Q(a) = -|a - optimum|^2, from a start at zero; returns it."""
    generator = torch.Generator().manual_seed(1)
    size = len(optimum)
    mean = torch.zeros(1, size, requires_grad=True)
    log_stddev = torch.full((1, size), -0.7, requires_grad=True)
    duals = Duals(size, limits, log_temperature=0.0, log_alpha_mean=0.0, log_alpha_stddev=0.0)
    optimiser = torch.optim.Adam(
        [{"params": [mean, log_stddev], "lr": 1e-2}, {"params": duals.parameters(), "lr": 1e-2}]
    )
    for step in range(steps):
        if step % 10 == 0:
            target = Gaussian(mean=mean.detach().clone(), stddev=log_stddev.detach().exp())
        actions = target.sample(32, generator)
        q = -(actions - torch.tensor(optimum)).square().sum(-1)
        online = Gaussian(mean=mean, stddev=log_stddev.exp())
        loss, stats = mpo_loss(
            online=online, target=target, actions=actions, q=q, duals=duals, limits=limits
        )
        optimiser.zero_grad()
        loss.mean().backward()
        optimiser.step()
        duals.clamp()
    return mean.detach()[0], log_stddev.detach().exp()[0], stats


def test_finds_the_optimum_of_a_quadratic_bandit():
    limits = Limits(epsilon_mean=1e-2, epsilon_stddev=1e-3)
    mean, stddev, _ = bandit(limits, [0.5, -0.3])
    torch.testing.assert_close(mean, torch.tensor([0.5, -0.3]), rtol=0.0, atol=0.05)
    assert (stddev < 0.3).all()


def test_the_action_penalty_holds_the_policy_inside_its_bounds():
    limits = Limits(epsilon_mean=1e-2, epsilon_stddev=1e-3, epsilon_penalty=0.1)
    free, _, _ = bandit(msgspec.structs.replace(limits, action_penalty=False), [2.0])
    held, _, _ = bandit(limits, [2.0])
    assert free.item() > 1.6
    assert held.item() < 0.75 * free.item()


@pytest.mark.parametrize(("shift", "sign"), [(0.0, 1.0), (1.0, -1.0)])
def test_a_multiplier_falls_below_its_limit_and_rises_above_it(shift, sign):
    old = Gaussian(mean=torch.zeros(4, 2), stddev=torch.ones(4, 2))
    online = Gaussian(mean=torch.full((4, 2), shift), stddev=torch.ones(4, 2))
    duals = Duals(2, Limits(), log_alpha_mean=1.0)
    loss, stats = mpo_loss(
        online=online,
        target=old,
        actions=torch.zeros(3, 4, 2),
        q=torch.zeros(3, 4),
        duals=duals,
        limits=Limits(),
    )
    loss.mean().backward()
    assert (torch.sign(duals.log_alpha_mean.grad) == sign).all()
    torch.testing.assert_close(stats.kl_mean, torch.full((4, 2), shift**2 / 2))
