"""A robot's model in files: MJCF or URDF, and beside it the effects that MJCF cannot express.

`corrected.xml` and `corrected.effects.json` are one model: whoever reads the first by its name
finds the second and puts its effects in as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco

from gfm.core import BadInputError, CommandKind, ConfigError
from gfm.effects import EffectInstance
from gfm.service.actuators import ActuatorRule, with_actuators
from gfm.service.effects_file import read_effects
from gfm.service.named_model import check_compiles, named_model
from gfm.sim.drive import write_out_damping
from gfm.sim.drive_names import name_after_joints

#: What stands in place of `.xml`.
EFFECTS_SUFFIX = ".effects.json"


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelFile:
    """A model that was read.

    Attributes:
        path: Of the MJCF file; None of one that is in none.
        spec: What it says.
        effects: What the file beside it says; empty where there is none.
        called: What the file calls drives that have another name than their joints, by joint.
        made: What was done to what the file says, in lines; none for MJCF that is whole.
    """

    path: Path | None
    spec: mujoco.MjSpec
    effects: tuple[EffectInstance, ...]
    called: Mapping[str, str]
    made: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """What messages call it."""
        return str(self.path) if self.path else f"MjSpec {self.spec.modelname!r}"

    @property
    def about(self) -> tuple[str, ...]:
        """What there is to know of the model, in lines: what stands beside it, what it calls."""
        lines = list(self.made)
        if self.effects and self.path:
            named = ", ".join(
                f"{e.effect.name} on {', '.join(e.joints) or 'all'}" for e in self.effects
            )
            lines.append(f"with {effects_path(self.path).name} beside it: {named}")
        lines += [
            f"{e.effect.name}: {e.effect.not_stepped}" for e in self.effects if e.effect.not_stepped
        ]
        if self.called:
            drives = ", ".join(
                f"{name or 'an actuator without a name'} for {joint}"
                for joint, name in self.called.items()
            )
            lines.append(f"actuators go by the joints that they drive: {drives}")
        return tuple(f"model {self.where}: {line}" for line in lines)


def effects_path(model: Path) -> Path:
    """Returns where the effects of an MJCF file would stand."""
    return model.with_suffix(EFFECTS_SUFFIX)


def read_model(name: Path | str, actuators: ActuatorRule | None = None) -> ModelFile:
    """Returns a model with what stands beside it.

    Args:
        name: Path of MJCF or URDF, or "robot_descriptions:NAME".
        actuators: What joints without an actuator get; None to leave them without.

    Raises:
        BadInputError: a file is missing or damaged, or the two do not belong together.
    """
    found = named_model(name)
    file = _made_ready(found.spec, found.path, found.made, actuators)
    beside = effects_path(found.path)
    effects = read_effects(beside) if beside.is_file() else ()
    check_there(file.spec, effects, f"effects {beside}", found.path)
    return replace(file, effects=effects)


def model_of(spec: mujoco.MjSpec, actuators: ActuatorRule | None = None) -> ModelFile:
    """Returns a model that is in no file, as if it had been read; `spec` stays as it is.

    Raises:
        BadInputError: MuJoCo does not compile it.
    """
    check_compiles(spec, f"MjSpec {spec.modelname!r}")
    return _made_ready(spec.copy(), None, (), actuators)


def _made_ready(
    spec: mujoco.MjSpec, path: Path | None, made: Sequence[str], actuators: ActuatorRule | None
) -> ModelFile:
    added = with_actuators(spec, actuators) if actuators else []
    write_out_damping(spec)
    return ModelFile(
        path=path,
        spec=spec,
        effects=(),
        called=name_after_joints(spec),
        made=(*made, *added),
    )


def check_there(
    spec: mujoco.MjSpec, effects: Iterable[EffectInstance], where: str, model: object
) -> None:
    """Raises BadInputError where one of `effects`, told by `where`, is on a joint of no `model`."""
    there = [joint.name for joint in spec.joints]
    for instance in effects:
        for name in instance.joints:
            if name not in there:
                raise BadInputError(
                    f"{where}: {instance.effect.name} on joint {name!r}, which {model} does not "
                    f"have; expected one of {', '.join(there)}"
                )


def read_robot(
    paths: Mapping[CommandKind, str], say: Callable[[str], object]
) -> dict[CommandKind, ModelFile]:
    """Returns one robot's models by kind of command.

    Args:
        paths: Of MJCF files.
        say: Told what was found beside them, in lines.

    Raises:
        BadInputError: a file is missing or damaged, or the files are of different robots.
    """
    files = {kind: read_model(Path(path)) for kind, path in paths.items()}
    shared_effects(files.values())
    for file in files.values():
        for line in file.about:
            say(line)
    return files


def shared_effects(files: Iterable[ModelFile]) -> tuple[EffectInstance, ...]:
    """Returns what stands beside all of one robot's models; nothing where there are none.

    Raises:
        ConfigError: beside one of them stands something else than beside another.
    """
    read = list(files)
    for other in read[1:]:
        if other.effects != read[0].effects:
            raise ConfigError(
                f"models {read[0].where} and {other.where}: beside the first stand "
                f"{_listed(read[0])}, beside the second {_listed(other)}; expected one robot"
            )
    return read[0].effects if read else ()


def _listed(file: ModelFile) -> str:
    return ", ".join(f"{e.effect.name} {dict(e.values)}" for e in file.effects) or "no effects"
