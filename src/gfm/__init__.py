"""Closes the gap between a MuJoCo model and the robot it stands for.

What a program may ask for is offered here, and loaded when it is asked for: docs/python.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from gfm.api.answer import Diagnosis
    from gfm.api.diagnosis import diagnose
    from gfm.api.doctor.examine import Examination, doctor
    from gfm.api.excitation import Excitation, excite
    from gfm.api.models import load_nominal
    from gfm.api.rollout import RolloutError, rollout_error
    from gfm.api.sources import load
    from gfm.experiments.fit_answer import Fit
    from gfm.experiments.fit_call import fit

__all__ = [
    "Diagnosis",
    "Examination",
    "Excitation",
    "Fit",
    "RolloutError",
    "__version__",
    "diagnose",
    "doctor",
    "excite",
    "fit",
    "load",
    "load_nominal",
    "rollout_error",
]

_LIVES_IN = {
    "Diagnosis": "gfm.api.answer",
    "Examination": "gfm.api.doctor.examine",
    "Excitation": "gfm.api.excitation",
    "Fit": "gfm.experiments.fit_answer",
    "RolloutError": "gfm.api.rollout",
    "diagnose": "gfm.api.diagnosis",
    "doctor": "gfm.api.doctor.examine",
    "excite": "gfm.api.excitation",
    "fit": "gfm.experiments.fit_call",
    "load": "gfm.api.sources",
    "load_nominal": "gfm.api.models",
    "rollout_error": "gfm.api.rollout",
}

# Type checkers read the imports above; a name that is not there is a mistake to them, too.
if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name not in _LIVES_IN:
            raise AttributeError(f"module 'gfm' has no attribute {name!r}")
        globals()[name] = getattr(import_module(_LIVES_IN[name]), name)
        return globals()[name]

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
