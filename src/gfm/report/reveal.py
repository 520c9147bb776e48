"""Was the verdict right? The named effects against those that a simulated robot had all along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gfm.diagnosis.output.result import NamedEffect, ParameterEstimate
from gfm.report.run import HiddenEffect, HiddenParameter
from gfm.report.words import known_interval


@dataclass(frozen=True, kw_only=True)
class ParameterCheck:
    """One true parameter beside its estimate.

    Attributes:
        name: Of the parameter.
        truth: From the sealed file.
        estimate: From the diagnosis, or None where it named no such thing.
    """

    name: str
    truth: HiddenParameter
    estimate: ParameterEstimate | None

    @property
    def inside(self) -> bool | None:
        """Whether the interval covers the truth; None where there is no interval."""
        known = None if self.estimate is None else known_interval(self.estimate)
        return None if known is None else known[0] <= self.truth.value <= known[1]


@dataclass(frozen=True, kw_only=True)
class EffectCheck:
    """One hidden effect and whether the diagnosis found it.

    Attributes:
        hidden: The truth.
        name_found: An effect of this name was named.
        joints_found: ... on the same joints.
        parameters: Truth against estimate.
    """

    hidden: HiddenEffect
    name_found: bool
    joints_found: bool
    parameters: tuple[ParameterCheck, ...]

    @property
    def finding(self) -> str:
        """The outcome in words."""
        if self.joints_found:
            return "yes"
        return "named, but elsewhere" if self.name_found else "no"


@dataclass(frozen=True, kw_only=True)
class Reveal:
    """The verdict against the truth.

    Attributes:
        checks: One per hidden effect.
        surplus: Named effects that the robot does not have.
    """

    checks: tuple[EffectCheck, ...]
    surplus: tuple[NamedEffect, ...]

    @property
    def names_right(self) -> bool:
        """Whether exactly the hidden effects were named, wherever they were put."""
        hidden = {check.hidden.effect for check in self.checks}
        named_wrongly = any(effect.effect not in hidden for effect in self.surplus)
        return all(check.name_found for check in self.checks) and not named_wrongly

    @property
    def joints_right(self) -> bool:
        """Whether they were also put on exactly the right joints."""
        return all(check.joints_found for check in self.checks) and not self.surplus


def reveal(named: Sequence[NamedEffect], hidden: Sequence[HiddenEffect]) -> Reveal:
    """Returns how the named effects compare with the hidden ones."""
    return Reveal(
        checks=tuple(_check(named, truth) for truth in hidden),
        surplus=tuple(one for one in named if not any(_same(one, truth) for truth in hidden)),
    )


def _same(named: NamedEffect, truth: HiddenEffect) -> bool:
    return named.effect == truth.effect and set(named.joints) == set(truth.joints)


def _check(named: Sequence[NamedEffect], truth: HiddenEffect) -> EffectCheck:
    namesakes = [one for one in named if one.effect == truth.effect]
    match = next((one for one in namesakes if _same(one, truth)), None)
    estimates = match.parameters if match is not None else {}
    return EffectCheck(
        hidden=truth,
        name_found=bool(namesakes),
        joints_found=match is not None,
        parameters=tuple(
            ParameterCheck(name=name, truth=value, estimate=estimates.get(name))
            for name, value in truth.parameters.items()
        ),
    )
