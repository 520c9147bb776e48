"""Retrace: agreement with rlax, and the returns it must reduce to."""

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from gfm.core import ShapeError
from gfm.rl.retrace import retrace_targets, trace_coefficients

FIXTURES = Path(__file__).parents[1] / "data" / "mpo_oracle.npz"
LENGTHS = (1, 2, 8, 16)
TRACED = ("q_tm1", "q_t", "v_t", "r_t", "discount_t", "log_rho_t")


def problems(length):
    with np.load(FIXTURES, allow_pickle=False) as data:
        prefix = f"retrace/{length}/"
        return {
            name.removeprefix(prefix): torch.from_numpy(data[name])
            for name in data.files
            if name.startswith(prefix)
        }


@pytest.mark.parametrize("length", LENGTHS)
def test_values_and_all_gradients_agree_with_rlax(length):
    stack = problems(length)
    for index in range(len(stack["lambda"])):
        x = {name: stack[name][index].clone().requires_grad_() for name in TRACED}
        c_t = trace_coefficients(x["log_rho_t"], float(stack["lambda"][index]))
        targets = retrace_targets(x["q_t"], x["v_t"], x["r_t"], x["discount_t"], c_t)
        error = targets - x["q_tm1"]
        torch.testing.assert_close(error, stack["error"][index], rtol=1e-9, atol=1e-9)
        (stack["weight"][index] * error).sum().backward()
        for name in TRACED:
            gradient = x[name].grad if x[name].grad is not None else torch.zeros_like(x[name])
            # At rho = 1 exactly the minimum has a kink; both sides pick a subgradient.
            if name == "log_rho_t" and (x[name] == 0.0).any():
                continue
            expected = stack[f"grad_{name}"][index]
            torch.testing.assert_close(gradient, expected, rtol=1e-9, atol=1e-9)


def test_fixtures_hold_enough_problems():
    assert sum(len(problems(length)["lambda"]) for length in LENGTHS) >= 100


def random_sequence(seed, steps, batch=3):
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape):
        return torch.randn(*shape, batch, generator=generator, dtype=torch.float64)

    return draw(steps - 1), draw(steps), draw(steps)


@given(seed=st.integers(0, 2**31), steps=st.integers(1, 12), discount=st.floats(0.0, 1.0))
@settings(max_examples=50, deadline=None)
def test_equals_discounted_return_with_bootstrap_when_traces_are_full(seed, steps, discount):
    q_t, v_t, r_t = random_sequence(seed, steps)
    v_t[:-1] = q_t  # on-policy and deterministic: the taken action is the expected one
    targets = retrace_targets(q_t, v_t, r_t, torch.full_like(r_t, discount), torch.ones_like(q_t))
    expected = v_t[-1]
    for t in reversed(range(steps)):
        expected = r_t[t] + discount * expected
        torch.testing.assert_close(targets[t], expected)


@given(seed=st.integers(0, 2**31), steps=st.integers(1, 12))
@settings(max_examples=25, deadline=None)
def test_is_the_one_step_target_when_lambda_is_zero(seed, steps):
    q_t, v_t, r_t = random_sequence(seed, steps)
    discount_t = torch.full_like(r_t, 0.9)
    c_t = trace_coefficients(torch.randn_like(q_t), 0.0)
    targets = retrace_targets(q_t, v_t, r_t, discount_t, c_t)
    torch.testing.assert_close(targets, r_t + 0.9 * v_t)


def test_nothing_after_a_terminal_transition_is_seen_before_it():
    q_t, v_t, r_t = random_sequence(0, 6)
    discount_t = torch.ones_like(r_t)
    discount_t[2] = 0.0
    c_t = torch.ones_like(q_t)
    before = retrace_targets(q_t, v_t, r_t, discount_t, c_t)
    after = [x.clone() for x in (q_t, v_t, r_t)]
    for tensor, first in zip(after, (2, 2, 3), strict=True):
        tensor[first:] += 100.0
    changed = retrace_targets(*after, discount_t, c_t)
    torch.testing.assert_close(changed[:3], before[:3])
    assert (changed[3:] != before[3:]).all()


def test_the_end_of_a_sequence_bootstraps_from_its_last_observation():
    ones = torch.ones(1, 1)
    target = retrace_targets(torch.zeros(0, 1), 5 * ones, 2 * ones, 0.5 * ones, torch.zeros(0, 1))
    assert target.item() == pytest.approx(2 + 0.5 * 5)


def test_unlikely_actions_cut_the_trace_and_likely_ones_do_not_amplify_it():
    c_t = trace_coefficients(torch.tensor([-1e4, 0.0, 50.0]), 0.95)
    torch.testing.assert_close(c_t, torch.tensor([0.0, 0.95, 0.95]))


def test_a_wrong_shape_is_named():
    q_t, v_t, r_t = random_sequence(0, 4)
    with pytest.raises(ShapeError, match=r"c_t has shape \(4, 3\), expected \(3, 3\)"):
        retrace_targets(q_t, v_t, r_t, torch.ones_like(r_t), torch.ones_like(r_t))
