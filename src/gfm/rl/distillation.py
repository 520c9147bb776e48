"""A policy that takes over a teacher's actions where it comes itself.

The data set grows with what the student meets (DAgger, Ross et al. 2011, arXiv 1011.0686).

Shape letters: N examples, O observation size, A action size.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import final

import numpy as np
import torch

from gfm.core.checks import Array32
from gfm.rl.networks import Normaliser, PolicyNetwork

_BATCH = 256


@final
class Student:
    """A policy network that goes on from given parameters.

    Args:
        tensors: Of the policy, as `GaussianPolicy` takes them.
        seed: Of the choice of examples.
    """

    def __init__(self, tensors: Mapping[str, Array32], seed: int) -> None:
        given = {name: torch.tensor(array) for name, array in tensors.items()}
        self._normaliser = Normaliser(len(given["shift"]))
        self._normaliser.shift.copy_(given.pop("shift"))
        self._normaliser.scale.copy_(given.pop("scale"))
        hidden = [len(given["first.bias"])]
        hidden += [len(given[name]) for name in sorted(given) if _is_hidden_bias(name)]
        size = given["first.weight"].shape[1], len(given["mean.bias"])
        self._policy = PolicyNetwork(*size, hidden, initial_stddev=1.0)
        self._policy.load_state_dict(given)
        self._began = deepcopy(self._policy).requires_grad_(requires_grad=False)
        self._optimiser = torch.optim.Adam(self._policy.parameters(), fused=True)
        self._rng = np.random.default_rng(seed)

    @property
    def tensors(self) -> dict[str, Array32]:
        """Copies of its parameters, as `GaussianPolicy` takes them."""
        tensors = self._policy.state_dict()
        tensors |= {"shift": self._normaliser.shift, "scale": self._normaliser.scale}
        return {name: np.array(tensor.numpy()) for name, tensor in tensors.items()}

    def learn(self, observation: Array32, action: Array32, learning_rate: float) -> None:
        """Makes one step on examples drawn from those given.

        Minimises the squared error of the mean. Not a divergence of the two Gaussians: that asks
        less of a joint the more it varies, and what varies most is what moves the tool most. The
        stddev is kept as the policy began with it.

        Args:
            observation: shape (N, O).
            action: The teacher's, shape (N, A).
            learning_rate: Adam's.
        """
        rows = self._rng.integers(len(observation), size=_BATCH)
        seen = self._normaliser(torch.from_numpy(observation[rows]))
        student, varied = self._policy(seen), self._began(seen).stddev
        missed = student.mean - torch.from_numpy(action[rows])
        changed = (student.stddev / varied).log()
        loss = (missed.square() + changed.square()).mean()
        for group in self._optimiser.param_groups:
            group["lr"] = learning_rate
        self._optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        self._optimiser.step()


def _is_hidden_bias(name: str) -> bool:
    return name.startswith("hidden.") and name.endswith(".bias")
