"""All effects by name: those of this package, and those that other packages offer."""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points

from gfm.core.errors import ConfigError, UnknownNameError
from gfm.effects.drive import (
    ActuatorGain,
    ActuatorLag,
    CoggingTorque,
    CommandDelay,
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
from gfm.effects.sensor import EncoderOffset

ENTRY_POINT_GROUP = "gfm.effects"

_OWN: tuple[type[Effect], ...] = (
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
    CommandDelay,
    ActuatorLag,
    TorqueSaturation,
    TorqueOffset,
    CoggingTorque,
    Backlash,
    JointElasticity,
    EncoderOffset,
)


@cache
def effect_library() -> dict[str, Effect]:
    """Returns every known effect by name.

    Raises:
        ConfigError: two effects have the same name.
    """
    library: dict[str, Effect] = {}
    offered = [point.load() for point in entry_points(group=ENTRY_POINT_GROUP)]
    for kind in (*_OWN, *offered):
        if kind.name in library:
            raise ConfigError(f"two effects are called {kind.name!r}")
        library[kind.name] = kind()
    return library


def find_effect(name: str) -> Effect:
    """Returns the effect called `name`.

    Raises:
        UnknownNameError: there is none; lists those there are.
    """
    library = effect_library()
    if name not in library:
        raise UnknownNameError("effect", name, library)
    return library[name]
