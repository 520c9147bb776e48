"""Amounts read off the torque that is missing along the measured motion.

Far from the truth a rollout goes where the robot never was: to first order it says little of a law
that changes within a small angle. Along the measured motion, what is missing is the sum of laws
times their amounts, however large these are: a linear regression. It is less exact than a rollout,
for it needs accelerations; so it only says where fits may begin.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gfm.diagnosis.inference.fitting import without
from gfm.diagnosis.search.candidates import Place
from gfm.effects import EffectInstance
from gfm.signals.torques import TorqueView, has_law


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
    laws = [view.law(one).ravel() for one in effects if has_law(one)]
    basis = np.linalg.qr(np.stack(laws, axis=1))[0] if laws else np.zeros((view.missing.size, 0))
    missing = without(view.missing.ravel(), basis)
    found = []
    for place in places:
        for group in place.probes:
            if not all(map(has_law, group)):
                continue
            columns = np.stack([view.law(one).ravel() for one in group], axis=1)
            amounts = np.linalg.lstsq(without(columns, basis), missing, rcond=1e-6)[0]
            values = place.effect.combine([one.values for one in group], amounts.tolist())
            if values is not None:
                found.append(place.instance(values))
    return found
