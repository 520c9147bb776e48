"""A driven pendulum, integrated here: what tests of the diagnosis are made from.

It shares neither code nor integrator with what is tested on it.
"""

from math import floor, sin

import numpy as np
from scipy.integrate import odeint

from gfm.core import CommandKind, Trajectory

MASS, LENGTH, ROTOR, STIFFNESS, DAMPING = 0.5, 0.2, 0.02, 20.0, 1.0
MODEL = f"""
<mujoco>
  <compiler angle="radian"/>
  <worldbody><body>
    <joint name="j" axis="0 -1 0" armature="{ROTOR}"/>
    <inertial pos="0 0 -{LENGTH}" mass="{MASS}" diaginertia="1e-9 1e-9 1e-9"/>
    <geom size="0.01" mass="0" pos="0 0 -{LENGTH}"/>
  </body></worldbody>
  <actuator><position name="j" joint="j" kp="{STIFFNESS}" kv="{DAMPING}"/></actuator>
</mujoco>
"""
PERIOD_S = 0.01


def swung(
    told,
    *,
    seed,
    noise,
    torque=lambda _q, _v: 0.0,
    delay=0.0,
    gain=1.0,
    limit=np.inf,
    loss=0.0,
    dead=0.0,
    uneven=0.0,
    inertia=0.0,
    start=0.0,
    finely=False,
) -> Trajectory:
    """Returns what it does when `told` positions every 10 ms, shape (T,).

    Beside its servo (times `gain`, `delay` late, of at most `limit` N m, less a share of `loss` for
    every N m, less `dead` N m, `uneven` more one way than the other) and gravity a `torque` of its
    state acts, and `inertia` comes on top of what MODEL has. Integrated `finely` where a kink of a
    law is met often.
    """
    stamps, commands = PERIOD_S * np.arange(len(told)), told.tolist()

    def motion(state, time_s):
        index = floor((time_s - delay) / PERIOD_S + 1e-9)
        q, v = state.tolist()  # numbers of Python: NumPy's are slow one by one
        servo = gain * (STIFFNESS * (commands[max(index, 0)] - q) - DAMPING * v)
        limited = min(max(servo, -limit), limit)
        drive = limited * (1.0 - loss * abs(limited))
        drive -= min(max(drive, -dead), dead)
        drive += 0.5 * uneven * abs(drive)
        gravity = -MASS * 9.81 * LENGTH * sin(q)
        return [v, (drive + gravity + torque(q, v)) / (MASS * LENGTH**2 + ROTOR + inertia)]

    # No step may go over a change of the command.
    accuracy = {"hmax": 5e-4 if finely else PERIOD_S, "rtol": 1e-7, "atol": 1e-9}
    answer = odeint(motion, [start, 0.0], stamps, tcrit=stamps[1:], **accuracy)
    noisy = answer[:, 0] + noise * np.random.default_rng(seed + 99).standard_normal(len(stamps))
    stamp_ns = np.round(stamps * 1e9).astype(np.int64)
    return Trajectory(
        name=f"run {seed}",
        joint_names=("j",),
        stamp_ns=stamp_ns,
        position=noisy[:, None],
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=told[:, None],
    )
