"""What `gfm.fit` does: `gfm fit` for programs, which have values where commands have files."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from gfm.api.models import Model
from gfm.api.sources import Sources, expanded
from gfm.core import Trajectory
from gfm.experiments.fit import COLD, WARM
from gfm.experiments.fit_answer import Fit
from gfm.experiments.fit_files import FitRequest, fit_files
from gfm.recording import write_recording


def fit(
    model: Model,
    recordings: Sources,
    *,
    folder: str | Path,
    holdout: Sources = (),
    minutes: float = 4.0,
    from_nothing: bool = False,
    period_s: float = 0.02,
    actors: int = 1,
    seed: int = 0,
    progress: bool = False,
) -> Fit:
    """Returns forces that, added to a model, make its simulation follow recordings.

    They are learned from inverse dynamics, then by reinforcement learning, for which services are
    started on this machine (extra `learn`).

    Args:
        model: Path of MJCF or URDF, or an `MjSpec`, or what `gfm.load_nominal` or a diagnosis made
            of it; a list of them for several kinds of command.
        recordings: What is to be followed: paths, folders, or what `gfm.load` returned.
        folder: A new folder for forces, report and logs.
        holdout: What errors are measured on; by default the last recording.
        minutes: Of reinforcement learning; 0 for what inverse dynamics tell.
        from_nothing: Begin with a policy that has learned nothing.
        period_s: Between two decisions about forces.
        actors: Processes.
        seed: Of everything random.
        progress: Whether to show on stderr how far it is.

    Raises:
        BadInputError: something given cannot be used; nothing was written.
        GfmError: a service failed.
    """
    given, held_out = expanded(recordings), expanded(holdout)
    with tempfile.TemporaryDirectory() as place:
        request = FitRequest(
            recordings=_as_files(given, Path(place, "given")),
            holdout=_as_files(held_out, Path(place, "held_out")),
            models=model,
            out=Path(folder),
            learning_s=60.0 * minutes,
            began=COLD if from_nothing else WARM,
            period_s=period_s,
            actors=actors,
            seed=seed,
        )
        return fit_files(request, Console(stderr=True, quiet=not progress))


def _as_files(given: Sequence[Path | Trajectory], place: Path) -> tuple[Path, ...]:
    """Returns where recordings are; writes values to `place`, for services read files."""
    paths = []
    for one in given:
        path = one if isinstance(one, Path) else place / f"{one.name}.mcap"
        if isinstance(one, Trajectory):
            write_recording(path, one)
        paths.append(path)
    return tuple(paths)
