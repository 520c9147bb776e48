"""Amounts read off the torque that is missing along the measured motion.

Far from the truth a rollout goes where the robot never was: to first order it says little of a law
that changes within a small angle. Along the measured motion, what is missing is the sum of laws
times their amounts, however large these are: a linear regression. It is less exact than a rollout,
for it needs accelerations; so it only says where fits may begin.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import without
from gfm.diagnosis.residuals.initial_states import orthonormal
from gfm.diagnosis.search.candidates import Place
from gfm.effects import EffectInstance
from gfm.signals.torques import TorqueView


def read_off(
    view: TorqueView, places: Sequence[Place], effects: Sequence[EffectInstance]
) -> list[EffectInstance]:
    """Returns candidates in the amounts that explain most of the missing torque.

    One for each group of probes of an effect that has a law in closed form.

    Args:
        view: Recordings as torques under the nominal model, (T, J).
        places: Where effects may act.
        effects: What is known to be missing: its amounts may be others beside a candidate.
    """
    laws = [view.law(one) for one in effects if one.has_law]
    return [one for place in places for one in _of_place(view, place, laws)]


def _of_place(view: TorqueView, place: Place, laws: Sequence[Array]) -> Iterator[EffectInstance]:
    """Yields what the missing torque of a place's own joints tells, beside laws (T, J) each."""
    own = [view.joints.index(name) for name in place.joints]
    known = [law[:, own].ravel() for law in laws]
    missing = view.missing[:, own].ravel()
    nothing = np.zeros_like(missing)  # where no law is known
    basis = orthonormal(np.stack([nothing, *known], axis=1))
    missing = without(missing, basis)
    for group in place.probes:
        if not all(one.has_law for one in group):
            continue
        columns = np.stack([view.law(one)[:, own].ravel() for one in group], axis=1)
        amounts = np.linalg.lstsq(without(columns, basis), missing, rcond=1e-6)[0]
        values = place.effect.combine([one.values for one in group], amounts.tolist())
        if values is not None:
            yield place.instance(values)
