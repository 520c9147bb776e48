"""What the phases of a run found, compared and put into a report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from gfm.diagnosis.output.result import Diagnosis
from gfm.effects import EffectInstance
from gfm.experiments.fit import BEST, FittedForces
from gfm.experiments.joint_control import JointControlTest, ModelErrors
from gfm.experiments.slsqp import Identified
from gfm.launch import Supervisor, statuses, summary
from gfm.report import HiddenEffect, ModelKind, PhaseTime, RunReport, SystemFacts
from gfm.report.transfer import Transfer


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What the phases of a run found.

    Attributes:
        test: The held-out recordings that models are compared on.
        nominal: The nominal model on them.
        identified: The baseline.
        diagnosis: The verdict.
        fitted: Generalized forces; None where that was left out.
        rest: Those for what the named effects leave; None also where nothing was named.
        facts: About the services, at the end.
        task: What a policy did on a robot before and after; None where that was left out.
    """

    test: JointControlTest
    nominal: ModelErrors
    identified: Identified
    diagnosis: Diagnosis
    fitted: FittedForces | None
    rest: FittedForces | None
    facts: SystemFacts
    task: Transfer | None = None

    @cached_property
    def effects(self) -> list[EffectInstance]:
        """The named effects, to be put into a model."""
        return [effect.instance() for effect in self.diagnosis.effects]

    def models(self) -> list[ModelErrors]:
        """Returns every model's errors on the held-out recordings."""
        test, found = self.test, self.identified
        identified = test.model_errors(ModelKind.IDENTIFIED, found.effects, _identified(found))
        corrected = test.model_errors(ModelKind.CORRECTED, self.effects, _corrected(self.diagnosis))
        alone = self._hybrid(ModelKind.HYBRID, self.fitted)
        beside = self._hybrid(ModelKind.CORRECTED_HYBRID, self.rest)
        return [self.nominal, identified, *alone, corrected, *beside]

    def _hybrid(self, model: ModelKind, fitted: FittedForces | None) -> list[ModelErrors]:
        if fitted is None:
            return []
        forces, hybrid = fitted.forces, fitted.problem.model
        return [self.test.hybrid_errors(model, forces, hybrid, fitted.detail)]

    def report(
        self,
        run_id: str,
        models: list[ModelErrors],
        durations_s: Mapping[str, float],
        hidden: tuple[HiddenEffect, ...],
    ) -> RunReport:
        """Returns the report.

        Args:
            run_id: Name of the run's folder.
            models: What `models` returned.
            durations_s: Of the run's phases.
            hidden: What the sealed file said.
        """
        phases = tuple(PhaseTime(name=name, seconds=s) for name, s in durations_s.items())
        return RunReport(
            run_id=run_id,
            robot="simulated Sawyer, driven through the robot bridge",
            simulated=True,
            diagnosis=replace(self.diagnosis, notes=(*self.diagnosis.notes, *self._notes())),
            comparison=self.test.comparison(models),
            rollouts=self.test.held_out_rollouts(models),
            training=self.fitted.curves if self.fitted else (),
            task=self.task,
            hidden=hidden,
            system=replace(self.facts, phases=phases),
        )

    def _notes(self) -> list[str]:
        notes = [
            f"Models are compared by open-loop rollouts of {len(self.test.recordings)} whole "
            "held-out recordings; what a wrong initial state explains is taken out, for all models "
            "alike."
        ]
        if self.fitted is not None:
            notes.append(
                f"Generalized forces (no named effect in their model): {self.fitted.detail}. "
                f"Chosen on training recordings; kept in checkpoints/{BEST}."
            )
        return notes


def system_facts(supervisor: Supervisor) -> SystemFacts:
    """Returns what the services say at the end; phases come later."""
    found = statuses(supervisor.transport)
    sums = summary(found)
    counts = ("env_steps", "replay_sequences", "learner_steps", "weights_version")
    return SystemFacts(
        processes=tuple(found),
        **{name: sums[name] for name in (*counts, "rejected_messages")},
        phases=(),
    )


def _identified(identified: Identified) -> str:
    ended = "" if identified.converged else ", stopped before it converged"
    return (
        f"gain and damping of every joint by SLSQP: {identified.iterations} iterations{ended} on "
        f"{', '.join(identified.recordings)}"
    )


def _corrected(diagnosis: Diagnosis) -> str:
    named = [f"{one.effect} ({', '.join(one.joints) or 'robot'})" for one in diagnosis.effects]
    return f"nominal with {', '.join(named)}" if named else "nominal: nothing was named"
