"""The constants that decide whether a name is given, each with what it was calibrated on.

All of them are figures of the score (`gfm.diagnosis.inference.score`) and of the confidence that
is made from it; whatever else the search has as a number only decides how long it takes.
`benchmarks/calibrate.py` fits `CONFIDENCE` and `UNWEIGHED` to robots whose truth is known
(docs/results/scored_search.md).
"""

from __future__ import annotations

#: Standard errors by which a hypothesis has to predict better than a simpler one.
CLEARLY = 2.0
#: RMS of what a right model leaves beside the noise, in units of it: integrators, time steps and
#: stamps alone make as much.
LEAST_DISCREPANCY = 1.0
#: Correlation between the discrepancies of two blocks: a wrong model is wrong alike everywhere, so
#: that many blocks tell no more than one over this.
WRONG_ALIKE = 0.05
#: Degrees of freedom of the predictive density: blocks differ in how far a model is off.
DEGREES_OF_FREEDOM = 4.0
#: Of a name: weights of four figures (see `output.claims.confidence`). That nothing else says it
#: as well: how clearly the hypothesis predicts better than with its best rival, and how far the
#: effect may differ between parts of the data; no constant is beside them: an exact law and its
#: equal are even odds. That its law holds: a constant, how much of what is left the law leaves by
#: not changing with the state, and how far its amount is from that which the missing torque tells.
CONFIDENCE = (2.29, -1.69, 4.25, -5.73, -6.08)
#: Share of what speaks for an effect that is taken to speak for it against its best rival, where
#: no time was left to weigh one.
UNWEIGHED = 0.53
#: Confidence from which on a name is given: below it is a suspect.
LEAST_CONFIDENCE = 0.5
#: Share, in squares, of what laws that hold do, that they may leave by not being quite exact: a
#: hundredth in amplitude. Nothing is looked for in it, and it speaks against no name.
INEXACT_SHARE = 1e-4
#: Held-out error, in noise floors, up to which a model is adequate, or share of the squared gap
#: that it leaves. They decide no name, but the verdict.
ADEQUATE_RATIO, ADEQUATE_SHARE = 2.0, 3e-3
