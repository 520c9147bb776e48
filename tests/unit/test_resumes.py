"""A learner that goes on is told from one that only says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from resumes import Resumes, acts_alike

from gfm.core import Weights
from gfm.recording.weights_file import write_weights

SIZES = {"shift": 3, "scale": 3, "first.bias": 4, "norm.weight": 4, "norm.bias": 4}


def policy(life: int, version: int, seed: int = 0) -> Weights:
    rng = np.random.default_rng(seed)
    shapes = {name: (size,) for name, size in SIZES.items()} | {"first.weight": (4, 3)}
    for head in ("mean", "stddev"):
        shapes |= {f"{head}.weight": (2, 4), f"{head}.bias": (2,)}
    tensors = {n: rng.uniform(0.5, 1.0, shape).astype(np.float32) for n, shape in shapes.items()}
    return Weights(version=version, created_ns=0, spec_digest="", tensors=tensors, life=life)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "policy.npz"


def counts(resumes):
    return resumes.alike, resumes.otherwise, resumes.unknown


def test_one_that_goes_on_where_it_was_acts_alike(file):
    resumes = Resumes(file)
    resumes.hear(policy(5, 100))
    resumes.hear(policy(5, 125))
    write_weights(file, policy(5, 120))
    resumes.hear(policy(7, 120))
    resumes.hear(policy(7, 145, seed=3))  # it has learned since
    assert counts(resumes) == (1, 0, 0)


@pytest.mark.parametrize(
    "heard", [policy(7, 120, seed=1), policy(7, 0), policy(7, 100)], ids=["acts", "anew", "back"]
)
def test_one_that_goes_on_otherwise_is_found(file, heard):
    resumes = Resumes(file)
    resumes.hear(policy(5, 100))
    write_weights(file, policy(5, 120))
    resumes.hear(heard)
    assert counts(resumes) == (0, 1, 0)


@pytest.mark.parametrize("kept", [None, policy(5, 90), policy(7, 120)], ids=["none", "old", "new"])
def test_without_the_policy_of_the_checkpoint_nothing_is_said(file, kept):
    resumes = Resumes(file)
    resumes.hear(policy(5, 100))
    if kept is not None:
        write_weights(file, kept)
    resumes.hear(policy(7, 120))
    assert counts(resumes) == (0, 0, 1)


def test_one_number_that_differs_in_its_last_bit_is_another_policy():
    ours = policy(5, 1)
    bias = ours.tensors["mean.bias"].copy()
    bias[0] = np.nextafter(bias[0], np.float32(2.0))
    assert acts_alike(ours, policy(6, 2))
    assert not acts_alike(ours, replace(ours, tensors={**ours.tensors, "mean.bias": bias}))
