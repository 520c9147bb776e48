"""Input that commands must refuse, each case in an empty folder of its own: see `messages.py`.

Names in command lines are relative to that folder, so that messages hold no path of a machine.
"""

from bad_inputs import of_diagnosis, of_files, of_policies, of_services, of_tracking
from bad_inputs.making import Case

CASES = (
    *of_diagnosis.CASES,
    *of_files.CASES,
    *of_policies.CASES,
    *of_tracking.CASES,
    *of_services.CASES,
)

__all__ = ["CASES", "Case"]
