"""One file that describes a training run, and the folder that a run leaves.

The file's tables `learner`, `actor` and `replay` are the settings of these services, which refuse
what they do not know; the environment stands in the learner's table, and the actors ask the learner
for it. `base` names a file beside it whose settings hold where it says nothing.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from gfm.core import BadInputError, ConfigError
from gfm.envs.registry import check_name
from gfm.service.config import base_of, differing, read_config, read_toml

Count = Annotated[int, Meta(ge=1)]

#: What may be another when a run is resumed: neither says what is learned.
_FREE = ("learner_steps", "actors")


class TrainConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One experiment.

    Attributes:
        env: Name of the environment.
        learner_steps: After which it is over.
        seed: Of everything random.
        actors: Processes.
        learner: Settings of the learner, the environment's among them.
        actor: Settings of the actors.
        replay: Settings of the replay service.
    """

    env: str
    learner_steps: Count
    seed: int = 0
    actors: Count = 1
    learner: dict[str, Any] = {}
    actor: dict[str, Any] = {}
    replay: dict[str, Any] = {}

    def __post_init__(self) -> None:
        check_name(self.env)


@dataclass(frozen=True, kw_only=True)
class RunFolder:
    """Where everything of one run is.

    Attributes:
        path: The folder.
    """

    path: Path

    @property
    def config(self) -> Path:
        """A copy of the experiment's file."""
        return self.path / "config.toml"

    @property
    def begun_from(self) -> Path:
        """A copy of the policy with which it began; none where that was a random one."""
        return self.path / "begun_from.npz"

    @property
    def checkpoints(self) -> Path:
        """The learner's folder."""
        return self.path / "checkpoints"

    @property
    def replay(self) -> Path:
        """What the replay service keeps."""
        return self.path / "replay"

    @property
    def policy(self) -> Path:
        """The newest policy."""
        return self.checkpoints / "policy.npz"

    @property
    def progress(self) -> Path:
        """Curves of the whole system."""
        return self.path / "progress"

    @property
    def logs(self) -> Path:
        """One file per process."""
        return self.path / "logs"


def open_run(
    path: Path, config: Path, *, resume: bool, begin_from: Path | None = None
) -> tuple[TrainConfig, RunFolder]:
    """Returns experiment and folder of a run that begins, or goes on.

    Args:
        path: Of the run's folder.
        config: The experiment's file.
        resume: Whether it goes on.
        begin_from: The policy with which a new one begins.

    Raises:
        BadInputError: the file cannot be used; a new run's folder is there; one to be resumed is
            not, or was begun with another experiment; there is no such policy.
    """
    experiment = read_config(TrainConfig, config, {})
    folder = RunFolder(path=path)
    if resume:
        _check_same(folder, config)
    elif path.exists():
        raise BadInputError(f"{path} is there already: give --resume, or another --out")
    elif begin_from is not None and not begin_from.is_file():
        raise BadInputError(f"policy {begin_from}: no such file")
    path.mkdir(parents=True, exist_ok=True)
    if config.resolve() != folder.config.resolve():
        shutil.copyfile(config, folder.config)
        if (base := base_of(config)) is not None:
            shutil.copyfile(base, path / base.name)
    if begin_from is not None and not resume:
        shutil.copyfile(begin_from, folder.begun_from)
    return experiment, folder


def _check_same(folder: RunFolder, config: Path) -> None:
    if not folder.config.is_file():
        raise BadInputError(f"{folder.path}: no run to resume, expected {folder.config.name} in it")
    begun, given = read_toml(folder.config), read_toml(config)
    others = [
        f"{name} is {here!r}, was {there!r}"
        for name, here, there in differing(given, begun)
        if name not in _FREE
    ]
    if others:
        raise ConfigError(f"{config}: {folder.path} was begun with another: {'; '.join(others)}")
