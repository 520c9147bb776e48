"""All effects by name: those of this package, and those that other packages offer."""

from __future__ import annotations

from functools import cache

from gfm.core.errors import UnknownNameError
from gfm.effects.contact import SurfaceContact
from gfm.effects.delays import ClockOffset, CommandDelay, EffortDelay, PositionDelay, ServoDelay
from gfm.effects.drive import (
    ActuatorGain,
    ActuatorLag,
    CoggingTorque,
    DriveDeadZone,
    DriveLoss,
    TorqueOffset,
    TorqueSaturation,
)
from gfm.effects.effect import Effect
from gfm.effects.elastic import Backlash, JointElasticity, JointSpring
from gfm.effects.friction import (
    AsymmetricFriction,
    CoulombFriction,
    CoupledFriction,
    LoadDependentFriction,
    QuadraticDrag,
    StribeckFriction,
    ViscousFriction,
)
from gfm.effects.inertial import Armature, GravityDirection, Payload
from gfm.effects.objects import ObjectCom, ObjectDamping, ObjectFriction, ObjectMass
from gfm.effects.plugins import offered_effects
from gfm.effects.sensor import EncoderOffset

_KINDS: tuple[type[Effect], ...] = (
    CoulombFriction,
    ViscousFriction,
    QuadraticDrag,
    StribeckFriction,
    AsymmetricFriction,
    LoadDependentFriction,
    CoupledFriction,
    JointSpring,
    Payload,
    GravityDirection,
    Armature,
    ActuatorGain,
    DriveLoss,
    DriveDeadZone,
    CommandDelay,
    ServoDelay,
    PositionDelay,
    EffortDelay,
    ClockOffset,
    ActuatorLag,
    TorqueSaturation,
    TorqueOffset,
    CoggingTorque,
    Backlash,
    JointElasticity,
    EncoderOffset,
    SurfaceContact,
    ObjectFriction,
    ObjectMass,
    ObjectCom,
    ObjectDamping,
)
_OWN = {kind.name: kind() for kind in _KINDS}


@cache
def effect_library() -> dict[str, Effect]:
    """Returns every known effect by name.

    Raises:
        ConfigError: an effect that an installed package offers cannot be used.
    """
    return _OWN | offered_effects(_OWN)


def find_effect(name: str) -> Effect:
    """Returns the effect called `name`.

    Raises:
        UnknownNameError: there is none; lists those there are.
    """
    library = effect_library()
    if name not in library:
        raise UnknownNameError("effect", name, library)
    return library[name]
