"""Reports with plausible made-up figures: what is rendered, not whether it is true."""

import numpy as np
import pytest

from gfm.core import Status
from gfm.diagnosis.evidence.adequacy import JointAdequacy, JointRegions, Residual
from gfm.diagnosis.evidence.domains import Agreement, TwoDomains
from gfm.diagnosis.evidence.links import EvidenceChain
from gfm.diagnosis.evidence.searched import Alternative, ConfusableSet, StepRow, Stopping
from gfm.diagnosis.output.result import (
    Diagnosis,
    ErrorSummary,
    EvidencePlot,
    NamedEffect,
    ParameterEstimate,
    RecordingSummary,
    Series,
    Suspect,
    Verdict,
)
from gfm.report import (
    Comparison,
    CurveGroup,
    HeldOutRollout,
    HiddenEffect,
    HiddenParameter,
    ModelError,
    ModelKind,
    PhaseTime,
    RunReport,
    SystemFacts,
    TrainingCurve,
)
from gfm.signals.energy import Dissipation, EnergyBalance

JOINTS = tuple(f"right_j{index}" for index in range(7))
FLOOR = 0.0011


def friction(joint="right_j1"):
    return NamedEffect(
        effect="coulomb_friction",
        joints=(joint,),
        parameters={"torque": ParameterEstimate(value=1.32, unit="N m", ci95=(1.27, 1.37))},
        confidence=0.97,
        native=True,
        evidence={"nats": 5400.0, "z_without": 17.4, "apart": 0.06, "bends": 0.2},
    )


def cogging(joint="right_j3"):
    return NamedEffect(
        effect="cogging_torque",
        joints=(joint,),
        parameters={
            "amplitude": ParameterEstimate(value=0.212, unit="N m", ci95=(0.19, 0.23)),
            "per_revolution": ParameterEstimate(value=12.0, unit="1", ci95=None),
            "phase": ParameterEstimate(value=-0.4, unit="rad", ci95=(float("nan"), 0.1)),
        },
        confidence=0.81,
        native=False,
    )


def friction_plot(rng, samples=5000):
    velocity = rng.uniform(-1.2, 1.2, samples)
    torque = -1.32 * np.tanh(velocity / 0.03) + rng.normal(0.0, 0.25, samples)
    law = np.linspace(-1.2, 1.2, 400)
    return EvidencePlot(
        title="Torque that the model lacks, against velocity",
        effect="coulomb_friction",
        joint="right_j1",
        x_label="velocity of right_j1 (rad/s)",
        y_label="residual torque (N m)",
        series=(
            Series(label="measured", x=velocity, y=torque, style="points"),
            Series(
                label="1.32 N m against the motion", x=law, y=-1.32 * np.sign(law), style="line"
            ),
        ),
    )


def cogging_plot(rng, samples=3000):
    position = rng.uniform(-2.0, 1.0, samples)
    torque = 0.212 * np.sin(12 * position - 0.4) + rng.normal(0.0, 0.08, samples)
    law = np.linspace(-2.0, 1.0, 600)
    return EvidencePlot(
        title="Torque that the model lacks, against angle",
        effect="cogging_torque",
        joint="right_j3",
        x_label="position of right_j3 (rad)",
        y_label="residual torque (N m)",
        series=(
            Series(label="measured", x=position, y=torque, style="points"),
            Series(label="fitted wave", x=law, y=0.212 * np.sin(12 * law - 0.4), style="line"),
        ),
    )


def make_residual(ratio, slow, goes_with=None):
    correlations = {"position": 0.1, "sign_of_velocity": -0.97}
    return Residual(
        ratio=ratio,
        slow=slow,
        white=slow <= 0.1,
        correlations=correlations,
        goes_with=goes_with,
    )


def make_chain(joints=JOINTS, name="coulomb_friction", where=("right_j1",), rival=None):
    before, after = make_residual(73.6, 1.0, "sign_of_velocity"), make_residual(1.1, 0.04)
    thirds = {"speed": (0.7, 0.2, 0.1), "position": (0.3, 0.4, 0.3), "drive": (0.2, 0.3, 0.5)}
    says = Agreement.OTHER_EFFECT if rival else Agreement.AGREES
    named = TwoDomains(
        effect=name,
        joints=where,
        named=True,
        rollout_share=0.93,
        torque_share=0.89,
        amount=1.02,
        agreement=says,
        rival=rival,
    )
    other = TwoDomains(
        effect="viscous_friction",
        joints=where,
        named=False,
        rollout_share=None,
        torque_share=0.03,
        amount=None,
    )
    return EvidenceChain(
        adequacy=tuple(JointAdequacy(joint=j, before=before, after=after) for j in joints),
        regions=tuple(
            JointRegions(joint=j, misfit_share=0.5, misfit_share_after=0.0, energy=thirds)
            for j in joints
        ),
        domains=(named, other),
        stopping=Stopping(
            steps=(
                StepRow(move="add", before=900.0, best=name, gain=5400.0, error=310.0, chosen=True),
                StepRow(
                    move="remove",
                    before=1.4,
                    best="",
                    gain=-3.0,
                    error=4.0,
                    chosen=True,
                    replaced="drag",
                ),
                StepRow(
                    move="intermittent",
                    before=1.3,
                    best="surface contact",
                    gain=1.5,
                    error=2.0,
                    chosen=False,
                    segments=6,
                ),
            ),
            left=1.3,
            room=2.5,
            room_error=3.0,
            reason="no candidate predicts clearly better",
            taken_out=("drag: it predicts as well without",),
        ),
        energy=EnergyBalance(
            drive_w=0.5,
            through_w=8.0,
            stored_w=0.01,
            dissipated_w=0.07,
            missing_w=0.42,
            named=(Dissipation(effect=name, joints=where, power_w=0.4, only_takes=True),),
            unexplained_w=0.02,
        ),
        confusable=(
            ConfusableSet(
                effect=name,
                joints=where,
                alternatives=(
                    Alternative(
                        effect="joint_spring",
                        joints=where,
                        errors=0.0,
                        told_by="slow motion over the whole range",
                    ),
                ),
                shown_by="reversals",
            ),
        ),
    )


def make_diagnosis(**changes):
    rng = np.random.default_rng(0)
    before = (0.004, 0.081, 0.012, 0.019, 0.003, 0.0021, 0.0016)
    after = (0.0012, 0.0015, 0.0013, 0.0014, 0.0012, 0.0011, 0.0011)
    values = {
        "verdict": Verdict.EXPLAINED,
        "sentence": "The model lacks dry friction of 1.32 N m at right_j1 and a cogging torque of "
        "0.212 N m at right_j3; with both, the held-out error falls from 0.0322 to 0.0013 rad, "
        "1.2 times the noise floor.",
        "effects": (friction(), cogging()),
        "suspects": (
            Suspect(
                effect="asymmetric_friction",
                joints=("right_j1",),
                reason="explains 0.4 % more than dry friction alone; below the 2.1 % that chance "
                "reaches once in a hundred",
                decided_by="slow reversals of right_j1 at constant speed in both directions",
                gain=0.61,
            ),
            Suspect(
                effect="torque_offset",
                joints=("right_j1",),
                reason="changes sign with the direction of motion, which an offset does not",
                gain=0.08,
            ),
        ),
        "error": ErrorSummary(before=0.0322, after=0.0013, noise_floor=FLOOR),
        "joints": {
            joint: ErrorSummary(before=b, after=a, noise_floor=FLOOR)
            for joint, b, a in zip(JOINTS, before, after, strict=True)
        },
        "recordings": (
            RecordingSummary(
                name="train_position_0.mcap",
                role="training",
                command="position",
                duration_s=24.0,
                rate_hz=99.8,
                before=0.031,
                after=0.0013,
            ),
            RecordingSummary(
                name="heldout_velocity_0.mcap",
                role="held-out",
                command="velocity",
                duration_s=75.0,
                rate_hz=99.7,
                before=0.0322,
                after=0.0013,
                warnings=("3 gaps longer than 50 ms, the longest 0.12 s at 4.3 s",),
            ),
        ),
        "corrected_xml": "<mujoco/>",
        "corrected_effects": (cogging(),),
        "chain": make_chain(),
        "plots": (friction_plot(rng), cogging_plot(rng)),
        "notes": (
            "right_j6 never turned faster than 0.05 rad/s: friction there cannot be told.",
            "Record slow reversals of right_j6, 0.1 to 0.5 rad/s, 20 s.",
        ),
        "provenance": {
            "model": {"path": "sawyer.xml", "sha256": "9f2c" * 16},
            "versions": {"gfm": "0.1.0", "mujoco": "4.0.0", "numpy": np.__version__},
            "seed": 0,
            "recordings": ["train_position_0.mcap", "heldout_velocity_0.mcap"],
        },
    }
    return Diagnosis(**(values | changes))


def make_rollout(rng, samples=4000):
    time_s = np.linspace(0.0, 20.0, samples)
    phase = 0.6 * time_s[:, None] + np.arange(7)
    setpoint = 0.8 * np.sign(np.sin(phase)) * np.minimum(1.0, 3.0 * np.abs(np.sin(phase)))
    measured = 0.8 * np.tanh(2.5 * np.sin(phase - 0.15)) + rng.normal(0, FLOOR, (samples, 7))
    lag = np.cos(phase - 0.15)
    sizes = {"nominal": 0.09, "identified": 0.05, "hybrid": 0.012, "corrected": 0.0012}
    return HeldOutRollout(
        recording="heldout_position_0.mcap",
        joints=JOINTS,
        time_s=time_s,
        setpoint=setpoint,
        measured=measured,
        predicted={ModelKind(name): measured + size * lag for name, size in sizes.items()},
    )


def make_training(samples=600):
    wall_clock_s = np.linspace(0.0, 240.0, samples)
    share = wall_clock_s / 240.0
    curves = (
        ("reward per step", CurveGroup.REWARD, "", 0.35 + 0.55 * (1 - np.exp(-4 * share))),
        ("held-out RMSE, hybrid", CurveGroup.ERROR, "rad", 0.012 + 0.05 * np.exp(-5 * share)),
        ("held-out RMSE, nominal", CurveGroup.ERROR, "rad", np.full(samples, 0.0322)),
        ("critic loss", CurveGroup.LOSS, "", 0.4 * np.exp(-3 * share) + 0.02),
        ("policy loss", CurveGroup.LOSS, "", 0.2 * np.exp(-2 * share) - 0.1),
        ("KL of the mean", CurveGroup.KL, "nat", 0.005 * (1 + 0.3 * np.sin(40 * share))),
        ("KL of the covariance", CurveGroup.KL, "nat", 1e-5 * (1 + 0.5 * np.cos(30 * share))),
    )
    return tuple(
        TrainingCurve(
            label=label,
            group=group,
            unit=unit,
            wall_clock_s=wall_clock_s,
            learner_steps=np.floor(share * 4200),
            value=value,
        )
        for label, group, unit, value in curves
    )


def make_comparison():
    sizes = {
        ModelKind.NOMINAL: (0.0322, "the model as published"),
        ModelKind.IDENTIFIED: (0.0188, "gain 0.94, damping 2.1 N m s/rad at right_j1"),
        ModelKind.HYBRID: (0.0061, "GFM alone, fitted to 5 recordings, 4,200 learner steps"),
        ModelKind.CORRECTED: (0.0013, "with the effects named above"),
    }
    return Comparison(
        joints=JOINTS,
        noise_floor=FLOOR,
        joint_noise_floors=(FLOOR,) * 7,
        models=tuple(
            ModelError(
                model=model,
                detail=detail,
                overall=overall,
                joints=tuple(overall * (0.4 + 0.2 * index) for index in range(7)),
            )
            for model, (overall, detail) in sizes.items()
        ),
    )


def make_system():
    roles = ("replay", "learner", "actor", "actor", "robot_bridge", "robot")
    return SystemFacts(
        processes=tuple(
            Status(role=role, name=f"{role}-{index}", pid=4000 + index, host="laptop")
            for index, role in enumerate(roles)
        ),
        env_steps=1_204_000,
        replay_sequences=37_625,
        learner_steps=4200,
        weights_version=4200,
        rejected_messages=0,
        phases=(
            PhaseTime(name="record", seconds=96.0),
            PhaseTime(name="diagnose", seconds=71.3),
            PhaseTime(name="fit a GFM", seconds=240.0),
        ),
    )


def hidden_friction(joint="right_j1"):
    parameters = {"torque": HiddenParameter(value=1.3, unit="N m")}
    return HiddenEffect(effect="coulomb_friction", joints=(joint,), parameters=parameters)


def make_run(**changes):
    rng = np.random.default_rng(1)
    values = {
        "run_id": "0007-friction",
        "robot": "simulated Sawyer, position and velocity commands at 100 Hz",
        "simulated": True,
        "diagnosis": make_diagnosis(),
        "comparison": make_comparison(),
        "rollouts": (make_rollout(rng),),
        "training": make_training(),
        "hidden": (hidden_friction(),),
        "system": make_system(),
    }
    return RunReport(**(values | changes))


@pytest.fixture
def diagnosis_with():
    """Makes a diagnosis, with other values for the fields that are named."""
    return make_diagnosis


@pytest.fixture
def run_with():
    """Makes a run's report, with other values for the fields that are named."""
    return make_run


@pytest.fixture
def chain_with():
    """Makes an evidence chain, with other names."""
    return make_chain
