"""What Sawyer's joints may do, by its published description."""

from __future__ import annotations

import numpy as np

from gfm.sim.sawyer_numbers import JOINTS
from gfm_robot_bridge.limits import Limits

#: rad/s^2, of the manufacturer's simulator.
_ACCELERATION = (10.0, 8.0, 10.0, 10.0, 12.0, 12.0, 12.0)


def sawyer_limits() -> Limits:
    """Returns what Sawyer's joints may do, by its published description."""
    return Limits(
        lower=np.array([joint.lower for joint in JOINTS]),
        upper=np.array([joint.upper for joint in JOINTS]),
        velocity=np.array([joint.velocity for joint in JOINTS]),
        acceleration=np.array(_ACCELERATION),
        effort=np.array([joint.effort for joint in JOINTS]),
    )
