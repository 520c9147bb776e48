"""What recordings are worth before anything is concluded from them.

Objections stop a diagnosis, findings go into its report. Both come from short checks, one a
property, each with its threshold explained beside it.
"""

from gfm.diagnosis.data.quality.channels import dead_positions
from gfm.diagnosis.data.quality.examine import (
    all_findings,
    doubts,
    findings_of,
    objection_to,
    same_measurements,
)
from gfm.diagnosis.data.quality.finding import Finding, FindingRow, Objection, gathered
from gfm.diagnosis.data.quality.lateness import Delays, delays
from gfm.diagnosis.data.quality.timing import predicted_positions, timing_of

__all__ = [
    "Delays",
    "Finding",
    "FindingRow",
    "Objection",
    "all_findings",
    "dead_positions",
    "delays",
    "doubts",
    "findings_of",
    "gathered",
    "objection_to",
    "predicted_positions",
    "same_measurements",
    "timing_of",
]
