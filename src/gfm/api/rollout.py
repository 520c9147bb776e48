"""How far a model is from recordings of its robot, in open loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gfm.api.models import Model, load_nominal
from gfm.api.recordings import check_together, without_strangers
from gfm.api.refusals import check_usable
from gfm.api.sources import Sources, read_files
from gfm.core import ConfigError
from gfm.diagnosis.data.segmentation import WHOLE, all_segments, in_model_order, prepared
from gfm.diagnosis.output.errors import rollout_errors
from gfm.recording.schemas import COMMAND, JOINT_STATES
from gfm.sim.passive import with_idle_drives


@dataclass(frozen=True, kw_only=True)
class RolloutError:
    """Position errors of open-loop rollouts along recorded commands.

    Attributes:
        rmse: Over all joints and recordings, rad.
        noise_floor: Of the sensors: the least that any model can leave, rad.
        joints: The first, by joint.
        recordings: The first, by recording.
    """

    rmse: float
    noise_floor: float
    joints: Mapping[str, float] = field(default_factory=dict)
    recordings: Mapping[str, float] = field(default_factory=dict)


def rollout_error(
    model: Model,
    recordings: Sources,
    *,
    as_measured: bool = False,
    joint_states: str = JOINT_STATES,
    command: str = COMMAND,
) -> RolloutError:
    """Returns the error that a diagnosis tells of a model, measured on some recordings.

    Rollouts are as long as recordings are (half a second under torque commands, where nothing
    keeps them on track), of the robot in the air.

    Args:
        model: Path of MJCF or URDF, or an `MjSpec`, or what `gfm.load_nominal` made of it; a
            list of them for several kinds of command.
        recordings: Paths, folders, or what `gfm.load` returned.
        as_measured: Whether rollouts begin as measured. Else they begin as fits best, for a
            measured speed is an estimate.
        joint_states: Topic of the measurements in files.
        command: Topic of the commands in files.

    Raises:
        BadInputError: something given cannot be used.
    """
    nominal = load_nominal(model)
    files = read_files(recordings, joint_states=joint_states, command=command)
    if not files:
        raise ConfigError("no recordings; expected at least one")
    runs, _ = without_strangers(nominal.specs, [run for _, run in files])
    read = [(path, run) for (path, _), run in zip(files, runs, strict=True)]
    check_together(nominal.specs, read)
    check_usable(nominal.specs, read, [])
    specs, runs = with_idle_drives(nominal.specs, in_model_order(nominal.specs, runs))
    problem = prepared(all_segments(specs, runs, given=nominal.effects, windows_s=WHOLE))
    errors = rollout_errors(problem, (), as_measured=as_measured)
    return RolloutError(
        rmse=errors.summary.before,
        noise_floor=errors.summary.noise_floor,
        joints={name: one.before for name, one in errors.joints.items()},
        recordings={one.name: one.before for one in errors.of_each(runs, "")},
    )
