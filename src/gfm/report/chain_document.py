"""The evidence chain as `report.json` has it, and what its steps say in a sentence each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from scipy.stats import beta

from gfm.diagnosis.evidence.adequacy import WORDS, JointAdequacy, Residual
from gfm.diagnosis.evidence.domains import Agreement, TwoDomains
from gfm.diagnosis.evidence.links import EvidenceChain
from gfm.diagnosis.output.claims import SPREAD_WIDTH, SPREADS_ASKED, SPREADS_HELD
from gfm.diagnosis.output.result import Diagnosis
from gfm.report import words
from gfm.signals.energy import EnergyBalance

#: Simulated robots without any hidden effect that were diagnosed (docs/results/known_truth.md), and
#: those of them on which anything was named.
CLEAN_ROBOTS, FALSE_ALARMS = 85, 0
AGREEMENTS = {
    Agreement.AGREES: "both say the same",
    Agreement.OTHER_AMOUNT: "the same effect in another amount",
    Agreement.OTHER_EFFECT: "the missing torque prefers another effect",
    Agreement.SILENT: "the missing torque says nothing of it",
}


def chain_json(chain: EvidenceChain | None) -> dict[str, object] | None:
    """Returns the chain as a part of `report.json`; None where there is none."""
    if chain is None:
        return None
    document = asdict(chain)
    for one, row in zip(chain.adequacy, document["adequacy"], strict=True):
        row["left"] = one.words
    for region, row in zip(chain.regions, document["regions"], strict=True):
        row["concentrated"] = region.words
    document["energy"] |= {"share": chain.energy.share, "even": chain.energy.even}
    if chain.stopping is not None:
        document["stopping"] |= {
            "clean_robots": CLEAN_ROBOTS,
            "false_alarms": FALSE_ALARMS,
            "false_alarm_rate_at_most": largest_rate(FALSE_ALARMS, CLEAN_ROBOTS),
        }
    return document


def hundredths(value: float) -> str:
    """Returns two digits after the point, zero without a sign."""
    return f"{round(value, 2) + 0.0:.2f}"


def adequacy_sentence(rows: Sequence[JointAdequacy]) -> str:
    """Returns whether the models are adequate, over all joints."""
    before, after = ([getattr(one, when).adequate for one in rows] for when in ("before", "after"))
    return (
        f"What the nominal model leaves is noise on {sum(before)} of {len(rows)} joints, "
        f"what the corrected model leaves on {sum(after)}."
    )


def goes_with(left: Residual) -> str:
    """Returns the signal that a missing torque goes with, and how closely."""
    if left.goes_with is None:
        return "noise" if left.adequate else words.NOTHING
    return f"{WORDS[left.goes_with]} ({left.correlations[left.goes_with]:+.2f})"


def agreement_words(row: TwoDomains) -> str:
    """Returns what two witnesses say of a candidate together."""
    if row.agreement is None:
        return "not accepted"
    other = f": {row.rival}" if row.rival else ""
    return AGREEMENTS[row.agreement] + other


def largest_rate(errors: int, cases: int) -> float:
    """Returns the upper end of the one-sided 95 % interval of a rate (Clopper and Pearson 1934)."""
    return 1.0 if errors >= cases else float(beta.ppf(0.95, errors + 1, cases - errors))


def false_alarms_sentence() -> str:
    """Returns the stopping rule's false alarms in words."""
    at_most = largest_rate(FALSE_ALARMS, CLEAN_ROBOTS)
    return (
        f"How often does this find what is not there? Of {CLEAN_ROBOTS} simulated robots "
        f"without any hidden effect, the search before this one named something on "
        f"{FALSE_ALARMS}. So few robots leave a rate of up to {100.0 * at_most:.1f} % "
        "possible (95 % confidence)."
    )


def amounts_sentence(diagnosis: Diagnosis) -> str:
    """Returns why amounts have intervals, or have none."""
    given = [
        words.known_interval(estimate) is not None
        for effect in diagnosis.effects
        for estimate in effect.parameters.values()
    ]
    if not given:
        return "There are no amounts: nothing was named."
    left = words.times(diagnosis.error.after, diagnosis.error.noise_floor, 2)
    if not any(given):
        return (
            f"No 95 % interval is given: the corrected model leaves {left} the noise floor on "
            "held-out recordings, and a model that is still wrong is wrong in all of them alike. "
            f'"roughly ± x" is {SPREAD_WIDTH} times how far other recordings of the same kind '
            "would put a value: so wide it held the truth "
            f"{SPREADS_HELD} of {SPREADS_ASKED} times on simulated robots that lacked something "
            "without a name beside a known effect (as the search before this one told amounts)."
        )
    return (
        f"{sum(given)} of {len(given)} amounts have an interval: the corrected model leaves "
        f"{left} the noise floor. Its width comes from how residuals differ between 60 blocks of "
        "the recordings, so that it also holds where they are no white noise. An amount without an "
        "interval was found by search, or the recordings do not depend on it."
    )


def energy_sentence(balance: EnergyBalance) -> str:
    """Returns whether energy adds up, in words."""
    unexplained = words.quantity(balance.unexplained_w, "W")
    share = f"{unexplained}, {100.0 * balance.share:.1f} % of what passes through the drives"
    if not all(one.possible for one in balance.named):
        return f"A named friction would put energy in, which no friction can ({share} unexplained)."
    if balance.even:
        return f"The balance is even: unexplained are {share}."
    return f"The balance is not even: unexplained are {share}. Something that was named is not it."
