"""What a robot says before it is driven, and whether it is the one that was expected."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np

from gfm.core import ConfigError
from gfm_robot_bridge.limits import Limits

#: A range that is so much narrower or wider than the published one is another robot's, rad.
_FARTHEST_RAD = 0.5
_VERSION = re.compile(r"(\d+\.\d+\.\d+)(\D.*)?")


def version_of(answer: object) -> str:
    """Returns the version of the robot's software from what `/rosapi/get_param` answered.

    Raises:
        ConfigError: there is none in it.
    """
    values = answer.get("values") if isinstance(answer, dict) else None
    text = values.get("value") if isinstance(values, dict) else values
    try:
        version = json.loads(text) if isinstance(text, str) else None
    except ValueError:
        version = None
    if not isinstance(version, str) or not (found := _VERSION.fullmatch(version)):
        raise ConfigError(
            f"the robot's software has the version {text!r}, expected three numbers: is rosapi "
            "running beside rosbridge?"
        )
    return found[1]


def check_version(version: str, accepted: tuple[str, ...]) -> None:
    """Refuses a robot whose software nobody accepted.

    Raises:
        ConfigError: it is none of them.
    """
    if version not in accepted:
        raise ConfigError(
            f"the robot's software has the version {version}, expected one of "
            f"{', '.join(accepted)} (robot_software)"
        )


def tighter(said: Limits, published: Limits, joint_names: tuple[str, ...]) -> Limits:
    """Returns the narrower of what a robot says of its joints and what is published of them.

    Raises:
        ConfigError: the ranges are too different to be those of one arm.
    """
    for end in ("lower", "upper"):
        there, here = getattr(said, end), getattr(published, end)
        j = int(np.argmax(np.abs(there - here)))
        if abs(there[j] - here[j]) > _FARTHEST_RAD:
            raise ConfigError(
                f"the robot says that the {end} end of {joint_names[j]} is at {there[j]:g} rad, "
                f"expected {here[j]:g}: is it a Sawyer?"
            )
    return replace(
        published,
        lower=np.maximum(said.lower, published.lower),
        upper=np.minimum(said.upper, published.upper),
        velocity=np.minimum(said.velocity, published.velocity),
        acceleration=np.minimum(said.acceleration, published.acceleration),
        effort=np.minimum(said.effort, published.effort),
    )


def same(one: Limits, other: Limits) -> bool:
    """Returns whether two robots' joints may do the same."""
    return all(np.array_equal(value, vars(other)[name]) for name, value in vars(one).items())
