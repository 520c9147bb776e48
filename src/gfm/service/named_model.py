"""What a user names as a model, as MuJoCo takes it: MJCF, URDF, or a robot of robot_descriptions.

The one way from a name to a spec. What had to be done for it is told in lines.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import mujoco

from gfm.core import BadInputError, ConfigError
from gfm.service.meshes import without_missing

#: Before the name of a robot of that package.
ROBOTS = "robot_descriptions:"
_URDF, _XACRO = "<robot", "<xacro:"
#: Its modules of robots end so; those with MJCF with "_mj" before that.
_ENDING = "_description"


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedModel:
    """A model as it was named.

    Attributes:
        path: Of its file.
        spec: What MuJoCo makes of it.
        made: What was done to it, in lines; none for MJCF that is whole.
    """

    path: Path
    spec: mujoco.MjSpec
    made: tuple[str, ...]


def named_model(name: Path | str) -> NamedModel:
    """Returns the model of a file or of a robot.

    Args:
        name: Path of MJCF or URDF, or "robot_descriptions:NAME".

    Raises:
        BadInputError: there is none, MuJoCo does not load it, or a mesh is missing that a mass
            comes from.
    """
    path = _robot(str(name).removeprefix(ROBOTS)) if str(name).startswith(ROBOTS) else Path(name)
    spec = _parsed(path)
    urdf = _URDF in path.read_text(encoding="utf-8", errors="replace")
    made = [f"{name} is {path}"] if str(name).startswith(ROBOTS) else []
    made += ["URDF, as MuJoCo reads it"] if urdf else []
    made += without_missing(spec, path)
    check_compiles(spec, str(path))
    made += _apart_at_rest(spec) if urdf else []
    return NamedModel(path=path, spec=spec, made=tuple(made))


def _apart_at_rest(spec: mujoco.MjSpec) -> list[str]:
    """Lets links not collide that touch at rest; returns which, in a line.

    Shapes of neighbours overlap where a joint holds them together, and URDF cannot say that this is
    no contact: the robot would push itself apart in every pose.
    """
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = model.geom_bodyid[data.contact.geom[: data.ncon]]
    pairs = sorted({tuple(sorted(model.body(i).name for i in pair)) for pair in bodies.tolist()})
    for first, second in pairs:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    told = ", ".join(f"{first} and {second}" for first, second in pairs)
    return [f"touch at rest, and so do not collide: {told}"] if pairs else []


def check_compiles(spec: mujoco.MjSpec, where: str) -> None:
    """Raises BadInputError where MuJoCo does not compile a spec."""
    try:
        spec.copy().compile()
    except ValueError as exc:
        raise _unloadable(where, exc) from exc


def _parsed(path: Path) -> mujoco.MjSpec:
    if not path.is_file():
        named = "" if path.suffix or path.name != str(path) else f", or {ROBOTS}{path}"
        raise BadInputError(f"model {path}: no such file; expected MJCF or URDF{named}")
    if _XACRO in path.read_text(encoding="utf-8", errors="replace"):
        raise BadInputError(f"model {path}: is xacro; expected URDF (xacro {path} > robot.urdf)")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as exc:
        raise _unloadable(str(path), exc) from exc


def _unloadable(where: str, exc: ValueError) -> BadInputError:
    reason = " ".join(str(exc).split())
    return BadInputError(f"model {where}: {reason}; expected MJCF or URDF that MuJoCo loads")


def _robot(name: str) -> Path:
    """Returns the file of a robot of robot_descriptions, which gets it from where it is kept."""
    try:
        package = import_module("robot_descriptions")
    except ModuleNotFoundError as exc:
        raise ConfigError(
            f"model {ROBOTS}{name}: the package robot_descriptions is missing; expected "
            "`pip install robot_descriptions`"
        ) from exc
    robots = [one.name for one in iter_modules(package.__path__) if one.name.endswith(_ENDING)]
    tried = (name, f"{name}_mj{_ENDING}", f"{name}{_ENDING}")
    found = next((one for one in tried if one in robots), None)
    if found is None:
        alike = get_close_matches(f"{name}{_ENDING}", robots, n=5, cutoff=0.5)
        raise ConfigError(
            f"model {ROBOTS}{name}: no such robot; expected one of those that the package has "
            f"(the nearest: {', '.join(alike) or 'none'})"
        )
    try:
        with redirect_stdout(sys.stderr):  # it tells what it downloads; stdout is for answers
            module = import_module(f"robot_descriptions.{found}")
    except Exception as exc:
        reason = " ".join(str(exc).split())
        raise ConfigError(
            f"model {ROBOTS}{name}: could not be downloaded, nor is it in the package's cache; "
            f"expected git and a network ({reason})"
        ) from exc
    return Path(next(_files_of(module)))


def _files_of(module: object) -> Iterator[str]:
    for kind in ("MJCF_PATH", "URDF_PATH"):
        if hasattr(module, kind):
            yield getattr(module, kind)
