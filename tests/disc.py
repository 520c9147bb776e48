"""A disc on an axis that a position servo turns: I q'' = kp (u - q) - kv q'."""

import numpy as np
from scipy.linalg import expm

DISC = """
<mujoco><option timestep="{step}" integrator="{integrator}" gravity="0 0 0"/><worldbody>
  <body name="disc"><joint name="j" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/></body>
</worldbody><actuator>
  <general name="j" joint="j" biastype="affine" gainprm="{kp}" biasprm="0 -{kp} -{kv}"/>
</actuator></mujoco>
"""


def followed(command, *, period_s, inertia, kp, kv, late_s=0.0):
    """Returns angles and torques of the servo, exactly, when each command is issued.

    A command takes effect `late_s` later, a whole number of ms, as does the period.

    Args:
        command: Held from each time to the next, rad, shape (C,).

    Returns:
        Angles, rad, and torques, N m, shape (C, 1) each; the command that arrives just then is in
        the torque.
    """
    fine_s = 1e-3
    each, late = round(period_s / fine_s), round(late_s / fine_s)
    motion = np.array([[0.0, 1.0, 0.0], [-kp / inertia, -kv / inertia, kp / inertia], [0, 0, 0]])
    step = expm(motion * fine_s)
    state, rows = np.zeros(3), []
    for k in range(each * (len(command) - 1) + 1):
        state[2] = command[max((k - late) // each, 0)]
        if k % each == 0:
            rows.append([state[0], kp * (state[2] - state[0]) - kv * state[1]])
        state = step @ state
    both = np.array(rows)
    return both[:, :1], both[:, 1:]
