"""Every objection to a recording, in the order in which they are asked for."""

from __future__ import annotations

from gfm.api.objections import channels, units
from gfm.api.objections.efforts import wrong_effort
from gfm.api.objections.objection import Objection
from gfm.core import Trajectory
from gfm.signals.limits import views_of
from gfm.sim.plant import Plant

#: Torques are judged on so many measurements at most: enough to know a sign by.
MOST_ROWS = 4000


def objection_to(recording: Trajectory, plant: Plant) -> Objection | None:
    """Returns why a recording cannot be used with a model, or None.

    Stamps come first: with them wrong, all speeds are; efforts last: they need all else right.
    """
    objection = (
        units.absurd_rate(recording)
        or channels.stuck_position(recording)
        or channels.stuck_effort(recording)
        or units.velocity_ratio(recording)
        or units.command_ratio(recording)
        or units.beyond_range(recording, plant)
        or units.wound_up(recording, plant)
    )
    if objection is not None:
        return objection
    head = recording.measured_at(slice(MOST_ROWS))
    energy = units.surplus_energy(head, plant)
    if energy is not None or recording.effort is None:
        return energy
    return wrong_effort(head, views_of(head, plant))
