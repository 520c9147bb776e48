"""The corrected model: MJCF that says what was added, and beside it what MJCF cannot say."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from gfm.diagnosis.result import NamedEffect
from gfm.effects import EffectInstance
from gfm.sim.plant import native_spec


def corrected_xml(
    spec: mujoco.MjSpec, instances: Sequence[EffectInstance], named: Sequence[NamedEffect]
) -> str:
    """Returns MJCF with every effect that plain MuJoCo expresses, and a comment for each.

    The integrator is part of the correction: amounts were fitted with the fourth-order one, and a
    first-order step would add an error of its own.
    """
    changed = native_spec(spec, instances)
    changed.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    changed.compile()
    head, body = changed.to_xml().split("\n", 1)
    comments = "\n".join(f"  <!-- {line} -->" for line in _lines(named))
    return f"{head}\n{comments}\n{body}" if comments else f"{head}\n{body}"


def _lines(named: Sequence[NamedEffect]) -> list[str]:
    if not named:
        return []
    return [
        "Corrected by gfm: what follows was added to the nominal model.",
        *(_line(effect) for effect in named),
        "Fitted with the integrator set below; another one adds an error of its own.",
    ]


def _line(effect: NamedEffect) -> str:
    where = f" on {', '.join(effect.joints)}" if effect.joints else ""
    amounts = ", ".join(_amount(name, p) for name, p in effect.parameters.items())
    native = "" if effect.native else " (not expressible here: see corrected.effects.json)"
    return f"{effect.effect}{where}: {amounts}{native}".replace("--", "- -")


def _amount(name: str, parameter: object) -> str:
    value, unit, interval = (getattr(parameter, key) for key in ("value", "unit", "ci95"))
    sure = "" if interval is None else f" [{interval[0]:.4g}, {interval[1]:.4g}]"
    return f"{name} {value:.5g}{sure} {'' if unit == '1' else unit}".rstrip()
