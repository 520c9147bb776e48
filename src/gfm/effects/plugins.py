"""Effects that other packages offer: loaded by entry point, and checked before they are used."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterable
from importlib.metadata import EntryPoint, entry_points

from gfm.core.errors import ConfigError
from gfm.effects.effect import Effect, Parameter, Scales, Scope

ENTRY_POINT_GROUP = "gfm.effects"
_NAME = re.compile(r"[a-z][a-z0-9_]*")
#: What an effect can change; one that changes none of them is no effect.
_WAYS = (
    *("apply", "retime", "lag_s", "servo_late_s", "effort_apart_s"),
    *("extra_friction", "drive_change", "compensation"),
)
#: Those of them that are asked for at every step.
_STEPPED = ("extra_friction", "drive_change")
#: Over what a law may be drawn.
SIGNALS = ("velocity", "position", "drive")
#: An ordinary joint, on which probes are tried.
USUAL_SCALES = Scales(
    torque_nm=1.0,
    excess_nm=0.1,
    velocity_rad_s=1.0,
    position_rad=1.0,
    peak_nm=3.0,
    servo_nm=3.0,
    inertia=0.1,
)


def offered_effects(taken: Iterable[str]) -> dict[str, Effect]:
    """Returns the effects of all installed packages, by name.

    Args:
        taken: Names that there are already.

    Raises:
        ConfigError: one of them cannot be used; says which, what was found, what was expected.
    """
    library: dict[str, Effect] = {}
    known = set(taken)
    for point in sorted(entry_points(group=ENTRY_POINT_GROUP), key=lambda point: point.value):
        effect = _checked(point)
        if effect.name in known:
            raise _refusal(point, f"is called {effect.name!r}", "a name that no other effect has")
        known.add(effect.name)
        library[effect.name] = effect
    return library


def _checked(point: EntryPoint) -> Effect:
    """Returns the effect behind an entry point.

    Raises:
        ConfigError: it is none, or lacks something.
    """
    try:
        kind = point.load()
    except Exception as exc:  # whatever somebody else's module raises
        raise _refusal(point, f"cannot be loaded ({exc!r})", "module:Class") from exc
    if not (inspect.isclass(kind) and issubclass(kind, Effect)):
        raise _refusal(point, f"is {kind!r}", "a subclass of gfm.effects.Effect")
    for problem, expected in (*_head(kind), *_ways(kind), *_amounts(kind)):
        raise _refusal(point, problem, expected)
    effect = kind()
    for problem, expected in _probes(effect):
        raise _refusal(point, problem, expected)
    return effect


def _refusal(point: EntryPoint, problem: str, expected: str) -> ConfigError:
    package = f" of {point.dist.name}" if point.dist else ""
    return ConfigError(f"effect {point.value}{package}: {problem}; expected {expected}")


def _head(kind: type[Effect]) -> Iterable[tuple[str, str]]:
    """Yields what is wrong with an effect's name, place and words, and what was expected."""
    if missing := sorted(getattr(kind, "__abstractmethods__", ())):
        yield f"does not define {', '.join(missing)}", "the methods of gfm.effects.Effect"
    name, shown_by = getattr(kind, "name", None), getattr(kind, "shown_by", None)
    if not (isinstance(name, str) and _NAME.fullmatch(name)):
        yield f"its name is {name!r}", "lower-case letters, digits and underscores"
    if not (isinstance(shown_by, str) and shown_by):
        yield f"its shown_by is {shown_by!r}", "the motion that shows it, in words"
    if not isinstance(kind.scope, Scope) or kind.scope is Scope.OBJECT:
        yield f"its scope is {kind.scope!r}", "JOINT, PAIR, LAST or ROBOT of gfm.effects.Scope"
    if kind.seen_over not in SIGNALS:
        yield f"is seen over {kind.seen_over!r}", f"one of {', '.join(SIGNALS)}"


def _ways(kind: type[Effect]) -> Iterable[tuple[str, str]]:
    """Yields what is wrong with how an effect acts, and what was expected."""
    if kind.stepwise and kind.torque is Effect.torque:
        yield "is stepwise and has no torque", "the torque to be put on the joint at every step"
    if not kind.stepwise and all(getattr(kind, way) is getattr(Effect, way) for way in _WAYS):
        yield "changes nothing", f"stepwise, or one of {', '.join(_WAYS)}"
    stepped = any(getattr(kind, way) is not getattr(Effect, way) for way in _STEPPED)
    if kind.native and (kind.stepwise or stepped):
        yield "is native and evaluated at every step", "native = False"


def _amounts(kind: type[Effect]) -> Iterable[tuple[str, str]]:
    """Yields what is wrong with an effect's parameters, and what was expected."""
    parameters = getattr(kind, "parameters", None)
    if not (
        isinstance(parameters, tuple)
        and parameters
        and all(isinstance(one, Parameter) for one in parameters)
    ):
        yield f"its parameters are {parameters!r}", "a tuple of gfm.effects.Parameter"
        return
    for one in parameters:
        yield from _amount(one)
    names = [one.name for one in parameters]
    if len(set(names)) != len(names):
        yield f"its parameters are called {', '.join(names)}", "each name once"
    for name in (*kind.fixed, *kind.valleys):
        if name not in names:
            yield f"{name!r} is fixed or has valleys", f"one of its parameters, {', '.join(names)}"


def _amount(one: Parameter) -> Iterable[tuple[str, str]]:
    """Yields what is wrong with one parameter, and what was expected."""
    if not (isinstance(one.name, str) and _NAME.fullmatch(one.name)):
        yield f"a parameter is called {one.name!r}", "lower-case letters and underscores"
    if not (isinstance(one.unit, str) and one.unit):
        yield f"the unit of {one.name} is {one.unit!r}", "an SI unit ('1' for a pure number)"
    if not (math.isfinite(one.lower) and math.isfinite(one.upper) and one.lower < one.upper):
        bounds = f"the bounds of {one.name} are {one.lower} and {one.upper}"
        yield bounds, "two finite numbers, the lower one first"


def _probes(effect: Effect) -> Iterable[tuple[str, str]]:
    """Yields what is wrong with the amounts with which recordings are asked about an effect."""
    names = {one.name for one in effect.parameters}
    try:
        groups = effect.probes(USUAL_SCALES)
    except Exception as exc:  # noqa: BLE001  # whatever somebody else's method raises
        yield f"its probes cannot be made ({exc!r})", "amounts for the given scales"
        return
    for group in groups:
        for values in group:
            if set(values) != names:
                yield f"a probe has {', '.join(sorted(values))}", ", ".join(sorted(names))
            elif not effect.admissible(values):
                yield f"a probe is {dict(values)}", "values within the bounds"
