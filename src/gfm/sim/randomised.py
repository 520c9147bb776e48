"""Variants of a model with other masses, friction, damping and servo gains.

Shape letters: V variants.
"""

from __future__ import annotations

import copy

import mujoco
import numpy as np

from gfm.core.checks import Array


def randomised_models(
    model: mujoco.MjModel, count: int, spread: float, rng: np.random.Generator
) -> tuple[mujoco.MjModel, ...]:
    """Returns V variants; kinematics and everything in MjData's layout stay as they are.

    Factors are log-uniform between 1 / (1 + spread) and 1 + spread, independent for every joint
    (damping, armature, gain of the servo), every geom (sliding friction) and every free body (mass
    and inertia). A robot's gravity compensation follows its masses, as it does in the model.
    """
    return tuple(_variant(model, spread, rng) for _ in range(count))


def _variant(model: mujoco.MjModel, spread: float, rng: np.random.Generator) -> mujoco.MjModel:
    def factors(size: int) -> Array:
        bound = np.log1p(spread)
        return np.exp(rng.uniform(-bound, bound, size=size))

    variant = copy.copy(model)
    hinged = variant.dof_armature > 0.0
    variant.dof_damping[:] *= factors(model.nv)
    variant.dof_armature[hinged] *= factors(int(hinged.sum()))
    variant.geom_friction[:, 0] *= factors(model.ngeom)
    gain = factors(model.nu)
    variant.actuator_gainprm[:, 0] *= gain
    variant.actuator_biasprm[:, 1:3] *= gain[:, None]
    _scale_masses(variant, factors(model.nbody))
    return variant


def _scale_masses(model: mujoco.MjModel, factor: Array) -> None:
    """Scales free bodies; the links' inertias are known well, and armature outweighs them."""
    free = int(mujoco.mjtJoint.mjJNT_FREE)
    bodies = model.jnt_bodyid[model.jnt_type == free]
    model.body_mass[bodies] *= factor[bodies]
    model.body_inertia[bodies] *= factor[bodies, None]
    mujoco.mj_setConst(model, mujoco.MjData(model))
