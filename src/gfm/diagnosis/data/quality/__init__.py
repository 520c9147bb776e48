"""What recordings are worth before anything is concluded from them: findings, for the report.

They come from short checks, one a property, each with its threshold explained beside it.
"""

from gfm.diagnosis.data.quality.examine import all_findings, doubts, findings_of
from gfm.diagnosis.data.quality.finding import Finding
from gfm.diagnosis.data.quality.lateness import Delays, delays

__all__ = [
    "Delays",
    "Finding",
    "all_findings",
    "delays",
    "doubts",
    "findings_of",
]
