"""Meshes that a model's file names, where they are, and how to do without."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mujoco

from gfm.core import BadInputError

#: Formats that MuJoCo reads.
_READ = (".stl", ".obj", ".msh")
_PACKAGE, _FILE = "package://", "file://"
#: So many are named where some are left out.
_NAMED = 4
#: compiler.inertiafromgeom: what bodies say of their mass does not count.
_ALWAYS = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE)


def without_missing(spec: mujoco.MjSpec, path: Path) -> list[str]:
    """Points `spec` to its meshes; takes those out that are not there, with their geometry.

    Returns:
        What was left out, in a line; none where all is there.

    Raises:
        BadInputError: a moving body would take its mass from one of them.
    """
    folder = path.parent / spec.meshdir
    missing = {}
    for mesh in list(spec.meshes):
        if not mesh.file:
            continue
        found = _place(mesh.file, path, folder)
        if found is None or found.suffix.lower() not in _READ:
            missing[mesh.name] = mesh.file
        elif mesh.file.startswith((_PACKAGE, _FILE)):
            mesh.file = str(found)
    if not missing:
        return []
    count = len(list(spec.meshes))
    _take_out(spec, missing, path)
    return [_left_out([Path(file).name for file in missing.values()], count)]


def _left_out(names: Sequence[str], count: int) -> str:
    listed = ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
    what = "meshes that are not there, or in no format that MuJoCo reads, are left out"
    return f"{what}: {len(names)} of {count} ({listed})"


def _place(file: str, path: Path, folder: Path) -> Path | None:
    """Returns where a mesh is; None where it is not."""
    if file.startswith(_PACKAGE):
        package, _, rest = file.removeprefix(_PACKAGE).partition("/")
        above = path.resolve().parents
        places = [one / rest for one in above if one.name == package]
        places += [one / package / rest for one in above]
    elif file.startswith(_FILE):
        places = [Path(file.removeprefix(_FILE))]
    else:
        places = [folder / file]
    return next((place for place in places if place.is_file()), None)


def _take_out(spec: mujoco.MjSpec, missing: dict[str, str], path: Path) -> None:
    """Deletes meshes and the geometry made of them."""
    for geom in list(spec.geoms):
        if geom.meshname not in missing:
            continue
        if _gives_mass(spec, geom):
            body = geom.parent.name or "a body without a name"
            raise BadInputError(
                f"model {path}: the mass of {body} comes from the mesh "
                f"{missing[geom.meshname]}, which is not there; expected the mesh, or an inertial"
            )
        spec.delete(geom)
    for mesh in list(spec.meshes):
        if mesh.name in missing:
            spec.delete(mesh)


def _gives_mass(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> bool:
    """Returns whether a moving body has less mass without a geometry."""
    told = geom.parent.explicitinertial and spec.compiler.inertiafromgeom != _ALWAYS
    weighs = geom.mass != 0.0 and geom.density != 0.0
    return bool(weighs and not told and _moves(geom.parent))


def _moves(body: mujoco.MjsBody) -> bool:
    while body.parent is not None:
        if body.joints:
            return True
        body = body.parent
    return False
