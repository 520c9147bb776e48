"""The corrected model: MJCF that says what was added, and beside it what MJCF cannot say.

MJCF shows what was changed in it: above every new line stands what was there before.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from gfm.diagnosis.output.result import ModelPair, NamedEffect, ParameterEstimate
from gfm.effects import EffectInstance
from gfm.effects.elements import let_friction_hold
from gfm.sim.mjcf_text import annotated, written
from gfm.sim.plant import compensations, native_spec
from gfm.sim.read_back import check_claims, check_read_back
from gfm.sim.step_laws import acts_at_every_step

#: Comments in front of a corrected model: around what was added, and before what it had.
HEADLINE = "Corrected by gfm: what follows was added to the nominal model."
FOOTLINE = (
    "Fitted with the integrator and dry friction that holds, as set below; others add errors of "
    "their own."
)
DISCRETE = (
    "Other integrators do not follow this model on its time step. Amounts were fitted as on ever "
    "shorter steps: on one of T the model is T/2 late."
)
BEFORE = "As before:"


def corrected_model(
    spec: mujoco.MjSpec,
    named: Sequence[NamedEffect],
    given: Sequence[EffectInstance] = (),
    *,
    implicit: bool = False,
) -> ModelPair:
    """Returns the model `spec`, beside which `given` stands, with the named effects added.

    Args:
        spec: The nominal model.
        named: What it lacks.
        given: What stands beside it.
        implicit: Whether its servos are too stiff for the fourth-order method.

    Raises:
        NotAppliedError: what was written, read again, is not what is claimed.
    """
    instances = [effect.instance() for effect in named]
    check_claims(spec, instances)
    nominal, changed = spec.copy().compile(), native_spec(spec, instances)
    compensated = nominal.body_gravcomp.any()
    model = changed.copy().compile()
    new = [
        effect
        for effect, instance in zip(named, instances, strict=True)
        if not effect.native
        or acts_at_every_step(instance)
        or (compensated and compensations(model, [instance]))
    ]
    before = [_as_named(instance) for instance in given]
    foot = [FOOTLINE, DISCRETE] if implicit else [FOOTLINE]
    added = [HEADLINE, *(_line(effect, new) for effect in named), *foot] if named else []
    lines = [*added, *(f"{BEFORE} {_line(effect, before)}" for effect in before)]
    xml = _corrected_xml(spec, changed, lines, implicit)
    check_read_back(xml, changed.compile())
    return ModelPair(xml=xml, effects=(*before, *new))


def model_pair(spec: mujoco.MjSpec, given: Sequence[EffectInstance]) -> ModelPair:
    """Returns the model `spec`, beside which `given` stands, as it is."""
    return ModelPair(xml=_xml(spec.copy()), effects=tuple(_as_named(one) for one in given))


def _as_named(instance: EffectInstance) -> NamedEffect:
    """Returns an effect that was given: how sure it is has been forgotten."""
    units = {p.name: p.unit for p in instance.effect.parameters}
    return NamedEffect(
        *instance.key,
        parameters={
            name: ParameterEstimate(value=value, unit=units[name], ci95=None)
            for name, value in instance.values.items()
        },
        confidence=1.0,
        native=instance.in_model,
    )


def _corrected_xml(
    nominal: mujoco.MjSpec, changed: mujoco.MjSpec, comments: Sequence[str], implicit: bool
) -> str:
    """Returns MJCF text with comments in front, and at every line that changed.

    The integrator is part of the correction: amounts were fitted with the fourth-order one, and a
    first-order step would add an error of its own; where servos are too stiff for it, with that
    under which they and dry friction hold together. So is dry friction that holds.
    """
    integrators = mujoco.mjtIntegrator
    changed.option.integrator = integrators.mjINT_DISCRETE if implicit else integrators.mjINT_RK4
    let_friction_hold(changed)
    head, body = annotated(_xml(nominal.copy()), _xml(changed)).split("\n", 1)
    return "\n".join([head, *(f"  <!-- {line} -->" for line in comments), body])


def _xml(spec: mujoco.MjSpec) -> str:
    if spec.comment.strip().startswith((HEADLINE, BEFORE)):  # MuJoCo keeps a file's first comment
        spec.comment = ""
    return written(spec)


def _line(effect: NamedEffect, beside: Sequence[NamedEffect]) -> str:
    where = f" on {', '.join(effect.joints)}" if effect.joints else ""
    amounts = ", ".join(_amount(name, p) for name, p in effect.parameters.items())
    part = "part of it" if effect.native else "it"
    there = f" ({part} cannot be said here: see the .effects.json beside)"
    told = f"{effect.effect}{where}: {amounts}{there if effect in beside else ''}"
    return told.replace("--", "- -")


def _amount(name: str, one: ParameterEstimate) -> str:
    sure = "" if one.ci95 is None else f" [{one.ci95[0]:.4g}, {one.ci95[1]:.4g}]"
    return f"{name} {one.value:.5g}{sure} {'' if one.unit == '1' else one.unit}".rstrip()
