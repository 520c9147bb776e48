"""Why a recording cannot be used with a model, whatever a command would do with it.

Short checks, one a property, each with its threshold explained beside it. What only puts results in
doubt is a finding of the diagnosis (`gfm.signals`).
"""

from gfm.api.objections.channels import dead_positions
from gfm.api.objections.examine import objection_to
from gfm.api.objections.objection import Objection
from gfm.api.objections.overlap import same_measurements

__all__ = ["Objection", "dead_positions", "objection_to", "same_measurements"]
