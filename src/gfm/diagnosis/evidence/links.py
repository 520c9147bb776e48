"""All links of the evidence chain, computed together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.evidence.adequacy import JointAdequacy, JointRegions, adequacy, localisation
from gfm.diagnosis.evidence.domains import TwoDomains, two_domains
from gfm.diagnosis.evidence.searched import ConfusableSet, Stopping, confusable_sets, stopping
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.trace import SearchResult
from gfm.effects import EffectInstance, Scope
from gfm.signals.energy import EnergyBalance, energy_balance
from gfm.signals.torque_domain import torque_domain


@dataclass(frozen=True, kw_only=True)
class EvidenceChain:
    """What a reader can check, in the order in which it is asked.

    Attributes:
        adequacy: Whether what each model leaves is noise, by joint.
        regions: Where the missing torque lies, by joint.
        domains: Named effects and the best others before two witnesses.
        stopping: How the search ended; None where none took place.
        energy: The balance over the held-out recordings.
        confusable: Names that the recordings cannot rule out, by named effect.
    """

    adequacy: tuple[JointAdequacy, ...]
    regions: tuple[JointRegions, ...]
    domains: tuple[TwoDomains, ...]
    stopping: Stopping | None
    energy: EnergyBalance
    confusable: tuple[ConfusableSet, ...]


def evidence_chain(
    problem: Problem,
    holdout: Sequence[Trajectory],
    found: SearchResult | None,
    effects: Sequence[EffectInstance],
    errors: tuple[Sequence[Array], Sequence[Array]],
) -> EvidenceChain:
    """Returns the chain for a verdict.

    Args:
        problem: Of the held-out recordings.
        holdout: They themselves.
        found: What was found on the training recordings; None where nothing was looked for.
        effects: What became part of the verdict, with its amounts.
        errors: Position errors of rollouts before and after, per segment, rad, (T, J) each.
    """
    # Torques are looked at without contacts: no object has a part in them.
    effects = [e for e in effects if e.effect.scope is not Scope.OBJECT]
    domain = torque_domain(problem, holdout)
    adequate = adequacy(domain, effects, errors)
    return EvidenceChain(
        adequacy=adequate,
        regions=localisation(domain, adequate),
        domains=two_domains(domain, found, effects) if found else (),
        stopping=stopping(found) if found else None,
        energy=energy_balance(domain, effects),
        confusable=confusable_sets(found, effects) if found else (),
    )
