"""Whether a corrected model has what was claimed, once its file is read again.

A parameter that is dropped without a word, by a compiler or on the way to a file, corrects nothing
and looks like a correction. So every claim has to change the compiled model, and the file has to
give the model that was meant, field by field.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from operator import attrgetter

import mujoco
import numpy as np

from gfm.core import GfmError
from gfm.effects import EffectInstance
from gfm.sim.plant import native_spec

#: What robots differ in, beside how contacts and friction are solved for.
PHYSICAL = (
    *("opt.gravity", "opt.timestep", "opt.integrator", "opt.cone"),
    *("body_mass", "body_inertia", "body_ipos", "body_pos", "body_gravcomp"),
    *("qpos0", "qpos_spring", "jnt_axis", "jnt_pos", "jnt_range", "jnt_stiffness"),
    *("dof_armature", "dof_damping", "dof_dampingpoly", "dof_frictionloss"),
    *("tendon_damping", "tendon_stiffness", "tendon_range", "tendon_limited", "eq_data"),
    *("geom_pos", "geom_friction", "geom_priority", "geom_condim", "pair_friction", "pair_dim"),
    *("geom_solref", "pair_solref"),
    *("actuator_trnid", "actuator_gear", "actuator_gainprm", "actuator_biasprm"),
    *("actuator_ctrlrange", "actuator_forcerange"),
    *("actuator_delay", "actuator_dynprm", "actuator_dyntype"),
)
FIELDS = (*PHYSICAL, "dof_solref", "dof_solimp", "tendon_solref_lim")
#: MuJoCo writes six digits, some of them of sums.
_RELATIVE, _ABSOLUTE = 1e-4, 1e-6


class NotAppliedError(GfmError):
    """A corrected model that is not the one that was claimed: a mistake of this project's."""


def check_claims(spec: mujoco.MjSpec, claimed: Sequence[EffectInstance]) -> None:
    """Refuses a claim that changes nothing in the model.

    Args:
        spec: The nominal model.
        claimed: Effects that are to be put into it; those that MuJoCo cannot express, and those
            that it has already, are passed over.

    Raises:
        NotAppliedError: a compiled model with one of them is the same as without.
    """
    nominal = spec.copy().compile()
    for instance in claimed:
        if not instance.effect.native or instance.in_model:
            continue
        changed = native_spec(spec, [instance]).compile()
        if not any(_differing(PHYSICAL, nominal, changed, relative=0.0, absolute=0.0)):
            where = f" on {', '.join(instance.joints)}" if instance.joints else ""
            raise NotAppliedError(f"{instance.effect.name}{where} changes nothing in the model")


def check_read_back(xml: str, meant: mujoco.MjModel) -> None:
    """Refuses MJCF that gives another model than the one that it was written of.

    Args:
        xml: As it is written to a file.
        meant: The model with all that is claimed.

    Raises:
        NotAppliedError: a field differs by more than MJCF's digits; says which, and by how much.
    """
    read = mujoco.MjModel.from_xml_string(xml)
    differing = list(_differing(FIELDS, meant, read, relative=_RELATIVE, absolute=_ABSOLUTE))
    if differing:
        raise NotAppliedError(f"the corrected model, read again: {'; '.join(differing)}")


def _differing(
    fields: Sequence[str],
    meant: mujoco.MjModel,
    read: mujoco.MjModel,
    *,
    relative: float,
    absolute: float,
) -> Iterator[str]:
    """Yields for every field that differs its name and the first number that does."""
    for name in fields:
        wanted, found = (np.asarray(attrgetter(name)(one), float) for one in (meant, read))
        if wanted.shape != found.shape:
            yield f"{name} has shape {found.shape}, expected {wanted.shape}"
            continue
        apart = ~np.isclose(found, wanted, rtol=relative, atol=absolute)
        if apart.any():
            place = tuple(int(i) for i in np.argwhere(apart)[0])
            at = f"[{', '.join(map(str, place))}]" if place else ""
            yield f"{name}{at} is {found[place]:g}, expected {wanted[place]:g}"
