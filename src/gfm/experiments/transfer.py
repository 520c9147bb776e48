"""What `gfm transfer` does: the whole loop on a task, on the robot before and after.

Every step leaves a folder that can be looked at and used again, and is not made a second time.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from gfm.api.diagnosis import DiagnoseRequest
from gfm.api.folders import check_folder, check_new_folder
from gfm.api.provenance import command_line, provenance
from gfm.core import BadInputError, Clock, ConfigError
from gfm.envs.matching_task import TASKS
from gfm.experiments.adapt import AdaptRequest, adapt_policy
from gfm.experiments.air_motion import AirMotions, air_motions, recorded_in
from gfm.experiments.attempt_choice import judged_on, learned_from
from gfm.experiments.attempt_files import Kept, recorded_s
from gfm.experiments.diagnose_command import diagnose_files
from gfm.experiments.drive_policy import drive_policy
from gfm.experiments.drive_request import DriveRequest
from gfm.experiments.evaluate import EvaluationRequest, load_arm, policy_path
from gfm.experiments.payload import named_payload
from gfm.experiments.policy_flags import ADAPTED, CORRECTED, PLACED, RANDOMISED, TOLD
from gfm.experiments.train import TrainRequest, train
from gfm.experiments.transfer_films import film, pair_to_show
from gfm.experiments.transfer_models import TransferModels
from gfm.policies import TRAINING_ON, shipped_policy
from gfm.report.evaluation import Evaluation
from gfm.report.files import write_texts
from gfm.report.transfer import (
    TITLES,
    Films,
    Transfer,
    Treatment,
    print_transfer,
    transfer_texts,
)
from gfm_wire import SetPayload

BEFORE = "before"
#: Where the arm is recorded by itself.
IN_THE_AIR = "in_the_air"
_NEED_NAMES = (PLACED, TOLD, ADAPTED, CORRECTED)


@dataclass(frozen=True, kw_only=True)
class TransferRequest:
    """What is asked for.

    Attributes:
        drive: The robot, the policy that begins, goals and attempts; its folder is the whole
            campaign's.
        minutes: For the search of the diagnosis.
        treatments: What is done to the policy, see TREATMENTS.
        learner_steps: Of each training; None for as many as the shipped settings say.
        air_s: Length of each motion in the air that is recorded beside attempts; 0 for none, as in
            the paper.
    """

    drive: DriveRequest
    minutes: float = 5.0
    air_s: float = 8.0
    treatments: tuple[str, ...] = (ADAPTED,)
    learner_steps: int | None = None

    @property
    def out(self) -> Path:
        """The campaign's folder."""
        return self.drive.out

    @property
    def start(self) -> Path:
        """The policy that begins."""
        return policy_path(self.drive.policy or shipped_policy(self.drive.task))

    def __post_init__(self) -> None:
        check_folder(self.out)
        if not (self.out / BEFORE).exists():
            check_new_folder(self.out)
        if self.drive.trials < 2:
            raise ConfigError(
                f"--trials is {self.drive.trials}, expected at least 2: the last attempts "
                "judge what is learned from others"
            )
        if not self.minutes > 0.0:
            raise ConfigError(f"--minutes is {self.minutes:g}, expected more than 0")
        if self.air_s and not 8.0 <= self.air_s <= 600.0:
            raise ConfigError(f"--air-seconds is {self.air_s:g}, expected 0, or 8 to 600")
        if self.learner_steps is not None and self.learner_steps < 1:
            raise ConfigError(f"--learner-steps is {self.learner_steps}, expected at least 1")


def transfer(
    request: TransferRequest, console: Console, clock: Clock, stopped: Callable[[], bool]
) -> Transfer:
    """Makes the steps that are left, and writes and prints the report.

    Raises:
        BadInputError: something given cannot be used, or the folder holds another campaign.
        GfmError: a service failed, or the robot does not answer.
        KeyboardInterrupt: a signal, or `stopped`, ended it; what there is is kept.
    """
    campaign = _Campaign(request, console, clock, stopped)
    before = campaign.drive(BEFORE, request.start)
    diagnosis = campaign.diagnose()
    treatments, films = [], Films()
    for name in request.treatments:
        if name in _NEED_NAMES and not diagnosis["effects"]:
            console.print(f"nothing was named: there is no corrected model ({name})")
            continue
        payload = named_payload(diagnosis) if name == TOLD else None
        if name == TOLD and payload is None:
            console.print(f"no payload was named: there is nothing to tell the robot ({name})")
            continue
        policy = campaign.treat(name)
        after = campaign.drive(f"after_{name}", policy, campaign.model(name), payload)
        treatments.append(Treatment(name=name, evaluation=after))
        films = films or campaign.films(name)
    report = Transfer(
        before=before,
        treatments=tuple(treatments),
        diagnosis=diagnosis,
        films=films,
        air_s=recorded_in(request.out / IN_THE_AIR).seconds,
        provenance=provenance({"policy": (request.start,)}, request.drive.seed, command_line()),
    )
    write_texts(request.out, transfer_texts(report))
    print_transfer(console, report)
    console.print(Text(str(request.out / "report.html")), soft_wrap=True)
    return report


@dataclass(frozen=True)
class _Campaign:
    """The steps, each of which leaves a folder."""

    request: TransferRequest
    console: Console
    clock: Clock
    stopped: Callable[[], bool]

    @property
    def models(self) -> TransferModels:
        """The files of the cells."""
        return TransferModels(task=self.request.drive.task, folder=self.request.out)

    def drive(
        self,
        name: str,
        policy: Path,
        model: Path | None = None,
        payload: SetPayload | None = None,
    ) -> Evaluation:
        """Returns what came of a policy on the robot, whose tool a model places."""
        self._say(f"{name}: the policy on the robot")
        out = self.request.out / name
        request = replace(self.request.drive, policy=policy, model=model, payload=payload, out=out)
        report = drive_policy(request, self.console).report
        if report is None:
            raise KeyboardInterrupt
        return report

    def diagnose(self) -> Mapping[str, Any]:
        """Returns what the nominal cell lacks by the recordings of before, as report.json says."""
        out = self.request.out / "diagnosis"
        report = out / "report.json"
        if not report.is_file():
            models, air = [self.models.nominal()], self.in_the_air()
            if air:
                models.append(self.models.by_positions())
            learned, held_out = self._recordings(air)
            self._say("diagnosis: what the nominal cell lacks")
            diagnose_files(
                DiagnoseRequest(
                    model=models,
                    recordings=learned,
                    holdout=held_out,
                    minutes=self.request.minutes,
                    seed=self.request.drive.seed,
                    words=command_line(),
                ),
                out,
                self.console,
                self.console,
                film=False,  # the campaign has films of its own
            )
        found: Mapping[str, Any] = json.loads(report.read_text())
        return found

    def in_the_air(self) -> AirMotions:
        """Returns recordings of the arm by itself; none where none are asked for."""
        if not self.request.air_s:
            return AirMotions()
        self._say(f"{IN_THE_AIR}: the arm by itself, above the basket")
        out, model = self.request.out / IN_THE_AIR, self.models.by_positions()
        request = replace(self.request.drive, out=out)
        return air_motions(request, model, self.request.air_s, self.console)

    def model(self, name: str) -> Path | None:
        """Returns the model that places the tool under a treatment; None for the nominal one."""
        if name == TOLD:
            return self.models.told()
        return self.models.corrected() if name in _NEED_NAMES else None

    def treat(self, name: str) -> Path:
        """Returns the policy after what is done to it."""
        if name in (PLACED, TOLD):
            return self.request.start
        policy = self.request.out / f"policy_{name}.npz"
        if not policy.is_file():
            if name == ADAPTED:
                self._adapt(policy)
            else:
                self._train(name, policy)
        return policy

    def films(self, name: str) -> Films:
        """Returns films of one target before and after a treatment, beside the report."""
        folders = {"as it came": BEFORE, TITLES[name]: f"after_{name}"}
        made = [Kept(self.request.out / folder, {}).attempts for folder in folders.values()]
        task = self.request.drive.task
        arm = load_arm(EvaluationRequest(task=task, model=self.model(name)))
        shown = pair_to_show(*made)
        files = {title: f"{folder}.mp4" for title, folder in folders.items()}
        for file, attempt in zip(files.values(), shown, strict=True):
            path = self.request.out / file
            if not path.exists() and (why := film(path, TASKS[task], arm, attempt)):
                return Films(missing=why)
        return Films(goal=shown[0].goal, files=files)

    def _adapt(self, policy: Path) -> None:
        self._say("adapted: the policy learns to do on the corrected model what it did")
        request = AdaptRequest(
            task=self.request.drive.task,
            policy=self.request.start,
            model=self.models.corrected(),
            out=policy,
            seed=self.request.drive.seed,
        )
        adapt_policy(request, self.console, self.clock, self.stopped)

    def _train(self, name: str, policy: Path) -> None:
        self._say(f"training_{name}: the policy goes on on the {name} model")
        folder, config = self.request.out / f"training_{name}", f"training_{name}.toml"
        if not folder.exists():
            shutil.copyfile(TRAINING_ON, self.request.out / TRAINING_ON.name)
            write_texts(self.request.out, {config: self._experiment(name)})
        request = TrainRequest(
            config=self.request.out / config,
            out=folder,
            resume=folder.exists(),
            begin_from=self.request.start,
        )
        run = train(request, self.console, self.clock, self.stopped)
        if self.stopped():
            raise KeyboardInterrupt
        shutil.copyfile(run.policy, policy)

    def _experiment(self, name: str) -> str:
        """Returns the experiment's file of one training."""
        steps = self.request.learner_steps
        lines = [f'base = "{TRAINING_ON.name}"', f'env = "{self.request.drive.task}"']
        lines += [] if steps is None else [f"learner_steps = {steps}"]
        if name == CORRECTED:
            model = json.dumps(str(self.models.corrected().absolute()))
            lines += ["[learner.environment.models]", f"velocity = {model}"]
        if name == RANDOMISED:
            lines += ["[learner.environment.control]", "randomisation = 0.5", "variants = 64"]
        return "\n".join(lines) + "\n"

    def _recordings(self, air: AirMotions) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
        """Returns the recordings to learn from, and those that judge."""
        made = Kept(self.request.out / BEFORE, {}).attempts
        lasts = {one.recording: recorded_s(one) for one in made}
        learned, judged = (
            tuple(Path(one.recording) for one in choice(made, lambda one: lasts[one.recording]))
            for choice in (learned_from, judged_on)
        )
        learned, judged = (*air.training, *learned), (*air.held_out, *judged)
        if not learned or not judged:
            raise BadInputError(
                f"{self.request.out / BEFORE}: {len(learned)} attempts to learn from and "
                f"{len(judged)} that judge have recordings of speeds, expected one of each at "
                "least: was the arm held by its bridge all the time?"
            )
        return learned, judged

    def _say(self, words: str) -> None:
        self.console.rule(Text(words), align="left")
