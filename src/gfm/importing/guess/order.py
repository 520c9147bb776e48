"""In which order commands without names are, by what the joints did.

Shape letters: T instants, J joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from gfm.core.checks import Array
from gfm.importing.guess.signals import Signal
from gfm.importing.ros_bag import LOG_TIME
from gfm.importing.tables import Table

#: Another order counts where joints follow it so much closer.
_CLOSER = 0.5


def in_followed_order(
    position: Mapping[str, Signal],
    command: Mapping[str, Signal],
    states: Table,
    commands: Table,
) -> dict[str, Signal]:
    """Returns position commands, each with the joint that follows it.

    Controllers often have another order of joints than models. Commands that names tell, and those
    beside positions that have no names either, stay as they are.

    Args:
        position: Measured, by joint.
        command: Told, by joint.
        states: Table of the measurements.
        commands: Table of the commands; where it is another one, both have `log_time`.
    """
    names = [name for name in command if name in position]
    if not names or not all(command[n].counted and not position[n].counted for n in names):
        return dict(command)
    measured = np.stack([position[name].values(states) for name in names], axis=1)
    if states is not commands:
        measured = measured[_rows_before(states, commands)]
    told = np.stack([command[name].values(commands) for name in names], axis=1)
    apart = np.sqrt(np.mean((measured[:, :, None] - told[:, None, :]) ** 2, axis=0))
    joints, places = linear_sum_assignment(apart)
    if apart[joints, places].sum() > _CLOSER * np.trace(apart):
        return dict(command)
    return {
        names[j]: replace(
            command[names[k]],
            joint=names[j],
            why=f"{names[j]} follows it ({apart[j, k]:.2g} apart), and not the model's order "
            f"({apart[j, j]:.2g})",
        )
        for j, k in zip(joints.tolist(), places.tolist(), strict=True)
    }


def _rows_before(states: Table, commands: Table) -> Array:
    """Returns for each command the last measurement before it, shape (T,)."""
    times, told = (np.array(one.columns[LOG_TIME]) for one in (states, commands))
    return np.maximum(np.searchsorted(times, told, side="right") - 1, 0)
