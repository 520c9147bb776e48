"""What speaks for each effect of a hypothesis: without it, against its rivals, part by part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gfm.diagnosis.inference.constants import UNWEIGHED
from gfm.diagnosis.inference.fitting import always, each_left_out
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.inference.steadiness import apart
from gfm.diagnosis.residuals.outliers import slopes
from gfm.diagnosis.residuals.segmented import SegmentedProblem
from gfm.diagnosis.search.hypothesis import Hypothesis, columns_of
from gfm.diagnosis.search.moves.reduce import Compared, gains_of_each
from gfm.diagnosis.search.trace import Evidence
from gfm.effects import EffectInstance, Key, Scope


def support(
    here: Hypothesis, compared: Sequence[Compared], held: Mapping[Key, Difference]
) -> dict[Key, Evidence]:
    """Returns what speaks for each effect of a hypothesis.

    Args:
        here: The hypothesis.
        compared: Its effects beside their best rivals.
        held: What spoke for those that a few segments judge, there: all others know nothing of it.
    """
    rivals = {one.instance.key: one for one in compared}
    left, parts = _left_by_joint(here), _apart(here)
    return {
        instance.key: Evidence(
            without=held.get(instance.key, without),
            rival=_over_rivals(rivals.get(instance.key), without),
            by=rivals[instance.key].rival if instance.key in rivals else None,
            left=_left_of(instance, here.problem, left),
            apart=parts[instance.key],
        )
        for without, instance in gains_of_each(here)
    }


def _over_rivals(compared: Compared | None, without: Difference) -> Difference | None:
    """Returns by how much a hypothesis predicts better with an effect than with its best rival."""
    if compared is None or compared.weighed:
        return None if compared is None else compared.over
    return Difference(UNWEIGHED * without.nats, without.error)


def _left_by_joint(here: Hypothesis) -> tuple[np.ndarray, np.ndarray]:
    """Returns the squared gap of each joint before and after, in units of the noise, (J,) each."""
    plain = here.problem.plain()
    gap = [
        np.maximum(plain.joint_costs(r) - 1.0, 1e-9) for r in plain.residuals([(), here.effects])
    ]
    return gap[0], gap[1]


def _left_of(
    instance: EffectInstance, problem: SegmentedProblem, gaps: tuple[np.ndarray, np.ndarray]
) -> float:
    local = instance.effect.scope in (Scope.JOINT, Scope.PAIR)
    names = instance.joints if local else problem.joints
    rows = [problem.joints.index(name) for name in names]
    return float(gaps[1][rows].sum() / gaps[0][rows].sum())


def _apart(here: Hypothesis) -> dict[Key, float]:
    """Returns by what share of itself each effect differs between parts of the data."""
    fitted, blocks = here.fit, here.blocks
    rests, _ = each_left_out(fitted.effects)
    whole, *rest = here.problem.plain().residuals([fitted.effects, *rests])
    weights = slopes(fitted.residual, here.problem.limits())
    rows = [piece.ravel() for piece in blocks.pieces]
    order = [np.flatnonzero(blocks.recording == one) for one in np.unique(blocks.recording)]
    told, steady = dict[Key, float](), always(fitted)
    for instance, without in zip(fitted.effects, rest, strict=True):
        own = columns_of(fitted, instance)
        beside = own | steady  # what acts now and then, a part may not know
        told[instance.key] = apart(
            fitted.jacobian[:, beside],
            fitted.residual,
            rows,
            order,
            own[beside],
            (without - whole) * weights,
        )
    return told
