"""Which cases there are: robots, what they hide, and how they are moved."""

from __future__ import annotations

from dataclasses import dataclass, replace

from known_truth.outside import SLIPPING, STRANGE, UNFORESEEN
from known_truth.robots import PENDULUM, PLANAR, SPATIAL, Robot


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A robot and how it is commanded.

    Attributes:
        name: Of both.
        robot: As it is built on average.
        kinds: Of its commands; recordings take turns.
        training: Motions that are recorded to learn from.
        duration_s: Of each recording.
        as_published: Whether the robot is not drawn anew for each case.
    """

    name: str
    robot: Robot
    kinds: tuple[str, ...]
    training: tuple[str, ...]
    duration_s: float
    as_published: bool = False


@dataclass(frozen=True, kw_only=True)
class Plan:
    """One case before anything is drawn.

    Attributes:
        name: Of the case.
        setup: The robot.
        category: single, pair, none, outside, poor, beside (a known effect and one outside) or
            everywhere (the same effect on every joint, in other amounts).
        effects: What is hidden.
        same_joint: Whether two effects share a joint.
        excitation: rich, still (the joint hardly moves), slow or short.
        seed: Of everything that is drawn.
    """

    name: str
    setup: Setup
    category: str
    effects: tuple[str, ...] = ()
    same_joint: bool = False
    excitation: str = "rich"
    seed: int


_THREE = ("waypoints", "multisine", "ladder")
_CARRIED = replace(SPATIAL, compensated=True)
HELD_OUT = ("chirp", "reaches")

SETUPS: tuple[Setup, ...] = (
    Setup(
        name="pendulum_position",
        robot=PENDULUM,
        kinds=("position",),
        training=("waypoints", "multisine", "ladder", "multisine"),
        duration_s=8.0,
    ),
    Setup(
        name="planar_effort",
        robot=PLANAR,
        kinds=("effort",),
        training=2 * _THREE,
        duration_s=8.0,
    ),
    Setup(
        name="planar_position",
        robot=PLANAR,
        kinds=("position",),
        training=2 * _THREE,
        duration_s=8.0,
    ),
    Setup(
        name="spatial_position",
        robot=SPATIAL,
        kinds=("position",),
        training=2 * _THREE,
        duration_s=12.0,
    ),
    Setup(
        name="spatial_both",
        robot=_CARRIED,
        kinds=("position", "velocity"),
        training=2 * _THREE,
        duration_s=12.0,
    ),
    Setup(
        name="spatial_velocity",
        robot=_CARRIED,
        kinds=("velocity",),
        training=2 * _THREE,
        duration_s=12.0,
    ),
)

SPATIAL_SETUPS = ("spatial_position", "spatial_both", "spatial_velocity")

VOCABULARY = (
    "coulomb_friction",
    "viscous_friction",
    "quadratic_drag",
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "coupled_friction",
    "joint_spring",
    "payload",
    "gravity_direction",
    "armature",
    "actuator_gain",
    "command_delay",
    "actuator_lag",
    "torque_saturation",
    "torque_offset",
    "cogging_torque",
    "backlash",
    "joint_elasticity",
    "encoder_offset",
    "drive_loss",
    "drive_dead_zone",
)

#: Two effects at once, and whether they share a joint.
PAIRS: tuple[tuple[str, str, bool], ...] = (
    ("coulomb_friction", "viscous_friction", True),
    ("coulomb_friction", "command_delay", False),
    ("payload", "coulomb_friction", False),
    ("joint_spring", "viscous_friction", False),
    ("coulomb_friction", "asymmetric_friction", True),
    ("stribeck_friction", "coulomb_friction", True),
    ("actuator_gain", "torque_offset", False),
    ("backlash", "viscous_friction", False),
    ("cogging_torque", "coulomb_friction", True),
    ("gravity_direction", "quadratic_drag", False),
    ("armature", "actuator_lag", False),
    ("load_dependent_friction", "joint_spring", True),
    ("joint_elasticity", "coulomb_friction", False),
    ("encoder_offset", "command_delay", False),
    ("torque_saturation", "viscous_friction", False),
    ("coulomb_friction", "coulomb_friction", False),
)

#: Effects that need no good excitation to be there, and how badly they are moved.
_POOR: tuple[tuple[str, str], ...] = (
    ("coulomb_friction", "still"),
    ("armature", "slow"),
    ("viscous_friction", "short"),
    ("command_delay", "slow"),
    ("torque_offset", "still"),
    ("payload", "short"),
)


#: An effect of the vocabulary and one outside it, together.
_BESIDE: tuple[tuple[str, str], ...] = (
    ("coulomb_friction", "cubic_spring"),
    ("actuator_gain", "torque_ripple"),
    ("armature", "position_friction"),
    ("viscous_friction", "cable_stop"),
    ("payload", "hysteretic_spring"),
    ("joint_spring", "root_friction"),
    ("actuator_lag", "voltage_limit"),
    ("cogging_torque", "command_steps"),
    ("torque_offset", "fading_drive"),
    ("quadratic_drag", "torque_ripple"),
    ("coulomb_friction", "hysteretic_spring"),
    ("armature", "cubic_spring"),
)
_BESIDE_EACH = 4

#: What a model may lack on every joint at once.
_EVERYWHERE = (
    "actuator_lag",
    "viscous_friction",
    "actuator_gain",
    "coulomb_friction",
    "armature",
)


def plans(seed: int = 0) -> list[Plan]:
    """Returns all cases, one and two joints first; each has a seed of its own."""
    made: list[Plan] = []
    for number, setup in enumerate(SETUPS):
        listed = [*_singles(setup), *_others(setup, number)]
        made += [
            replace(plan, seed=1_000_000 * seed + 1000 * number + i)
            for i, plan in enumerate(listed)
        ]
    return made


def unforeseen_plans(seed: int = 0) -> list[Plan]:
    """Returns cases with laws that nobody had thought of: alone, and beside dry friction."""
    setups = [setup for setup in SETUPS if setup.name not in SPATIAL_SETUPS[:2]]
    cases = [
        Plan(
            name=f"{setup.name}-{category}-{'+'.join(effects)}",
            setup=setup,
            category=category,
            effects=effects,
            seed=0,
        )
        for setup in setups
        for law in UNFORESEEN
        for category, effects in (("outside", (law,)), ("beside", ("coulomb_friction", law)))
    ]
    return [replace(one, seed=1_000_000 * seed + 9000 + i) for i, one in enumerate(cases)]


def _singles(setup: Setup) -> list[Plan]:
    """Returns one case for each effect that the robot can have."""
    chosen = [e for e in VOCABULARY if e != "coupled_friction" or len(setup.robot.joints) > 1]
    if setup.name in SPATIAL_SETUPS:
        # Seven joints take long: each effect is hidden once in one of the three.
        chosen = chosen[SPATIAL_SETUPS.index(setup.name) :: 3]
    return [
        Plan(name=f"{setup.name}-{e}", setup=setup, category="single", effects=(e,), seed=0)
        for e in chosen
    ]


def _others(setup: Setup, number: int) -> list[Plan]:
    """Returns cases with other than one effect, or with poor excitation."""
    joints = len(setup.robot.joints)
    fitting = [pair for pair in PAIRS if joints > 1 or pair[2]]
    pairs = [fitting[(number * 3 + i) % len(fitting)] for i in range(3)]
    strange = [*STRANGE, SLIPPING]
    unknown = [strange[(number * 2 + i * 3) % len(strange)] for i in range(3)]
    poor = [_POOR[(number + i * 2) % len(_POOR)] for i in range(2)]
    # What nothing explains is searched for long: on seven joints for too long.
    few = setup.name not in SPATIAL_SETUPS
    beside = _BESIDE[_BESIDE_EACH * number :][:_BESIDE_EACH] if few else ()
    all_joints = [_EVERYWHERE[(number * 2 + i) % len(_EVERYWHERE)] for i in range(2)]
    everywhere = all_joints if joints > 1 else ()

    def plan(label: str, category: str, effects: tuple[str, ...], **more: object) -> Plan:
        name = f"{setup.name}-{label}"
        made = Plan(name=name, setup=setup, category=category, effects=effects, seed=0)
        return replace(made, **more)  # type: ignore[arg-type]

    return [
        *(plan(f"{a}+{b}", "pair", (a, b), same_joint=same) for a, b, same in pairs),
        *(plan(f"none_{i}", "none", ()) for i in range(3)),
        *(plan(f"outside-{one}", "outside", (one,)) for one in unknown),
        *(plan(f"poor-{e}-{how}", "poor", (e,), excitation=how) for e, how in poor),
        *(plan(f"beside-{a}+{b}", "beside", (a, b)) for a, b in beside),
        *(plan(f"everywhere-{e}", "everywhere", joints * (e,)) for e in everywhere),
    ]
