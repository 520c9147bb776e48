"""A robot's nominal model as MJCF text: what a user of MuJoCo would have."""

from __future__ import annotations

import numpy as np

from known_truth.robots import Array, Robot

#: Declared dry friction as it must be written to hold: MuJoCo's defaults let a joint creep.
_HOLDING = 'solreffriction="0.004 1" solimpfriction="0.9999 0.9999 0.001"'


def mjcf(robot: Robot, kind: str) -> str:
    """Returns the model whose actuators take commands of `kind`: effort, position, velocity."""
    lines = [
        f'<mujoco model="{robot.name}">',
        '  <compiler angle="radian"/>',
        '  <option timestep="0.002" integrator="RK4"/>',
        "  <worldbody>",
        *_links(robot),
        "  </worldbody>",
        "  <actuator>",
        *(f"    {_drive(robot, j, kind)}" for j in range(len(robot.joints))),
        "  </actuator>",
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def _links(robot: Robot) -> list[str]:
    opened: list[str] = []
    closed: list[str] = []
    for j, name in enumerate(robot.joints):
        indent = "  " * (j + 2)
        carried = ' gravcomp="1"' if robot.compensated else ""
        opened += [
            f'{indent}<body name="link_{name}" pos="{_text(robot.offset[j])}" '
            f'quat="{_text(quaternion(robot.turn[j]))}"{carried}>',
            f'{indent}  <inertial pos="{_text(robot.com[j])}" mass="{robot.mass[j]:.12g}" '
            f'diaginertia="{_text(robot.inertia[j])}"/>',
            f"{indent}  {_joint(robot, j)}",
        ]
        closed.insert(0, f"{indent}</body>")
    return opened + closed


def _joint(robot: Robot, j: int) -> str:
    parts = [
        f'<joint name="{robot.joints[j]}" axis="{_text(robot.axis[j])}"',
        f'armature="{robot.armature[j]:.12g}" damping="{robot.damping[j]:.12g}"',
    ]
    if robot.friction[j]:
        parts.append(f'frictionloss="{robot.friction[j]:.12g}" {_HOLDING}')
    if robot.compensated:
        parts.append('actuatorgravcomp="true"')
    return " ".join(parts) + "/>"


def _drive(robot: Robot, j: int, kind: str) -> str:
    name = f'name="{robot.joints[j]}" joint="{robot.joints[j]}"'
    match kind:
        case "position":
            gains = f'kp="{robot.stiffness[j]:.12g}" kv="{robot.servo_damping[j]:.12g}"'
            return f"<position {name} {gains}/>"
        case "velocity":
            return f'<velocity {name} kv="{robot.velocity_gain[j]:.12g}"/>'
        case _:
            return f"<motor {name}/>"


def quaternion(turn: Array) -> Array:
    """Returns w x y z of a rotation vector, shape (4,)."""
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle else turn
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])


def _text(values: Array) -> str:
    return " ".join(f"{value:.12g}" for value in values)
