"""Whether models and recordings speak of the same joints and the same commands."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches

from gfm.api.doctor.lines import doubt, refusal, some, well
from gfm.api.models import NominalModel
from gfm.api.recordings import Files, without_strangers
from gfm.core import CommandKind
from gfm.report.checks import Check
from gfm.sim.still import unrecorded

JOINTS, COMMANDS = "joint names", "kind of command"
#: How alike a recorded name and one of the model must be for the second to be offered.
_ALIKE = 0.6


def joint_names(nominal: NominalModel, files: Files) -> Iterator[Check]:
    """Checks that every recorded joint is in the models and driven there, and none is missing."""
    recorded = files[0][1].joint_names
    uncommanded = {name for _, run in files for name in run.uncommanded}
    strange = False
    for kind, spec in nominal.specs.items():
        joints = [joint.name for joint in spec.joints]
        drives = [actuator.name for actuator in spec.actuators]
        absent = [name for name in recorded if name not in joints]
        idle = [n for n in recorded if n in joints and n not in drives and n not in uncommanded]
        if absent:
            yield refusal(
                JOINTS, f"not in the {kind} model: {some(absent)}", _rename(absent, joints)
            )
        if idle:
            advice = "give the model an actuator for each, or leave their commands out"
            yield refusal(
                JOINTS, f"commanded, but not driven in the {kind} model: {some(idle)}", advice
            )
        strange |= bool(absent or idle)
        still = list(unrecorded(spec, recorded))
        if still:
            advice = "fix them in the model where the robot held them, or record them"
            found = (
                f"driven in the {kind} model, never recorded: {some(still)}: taken to stand still"
            )
            yield doubt(JOINTS, found, advice)
    if not strange:
        yield well(
            JOINTS,
            f"all {len(recorded)} in the model: {some(recorded)}",
        )


def left_out(nominal: NominalModel, files: Files) -> Iterator[Check]:
    """Tells of joints that are measured, and neither commanded nor in a model."""
    _, notes = without_strangers(nominal.specs, [run for _, run in files])
    for note in notes:
        found = note.removesuffix(" Left out.").rstrip(".")
        yield doubt(JOINTS, f"{found}: left out", "nothing, if they stood still or weigh little")


def _rename(absent: Sequence[str], joints: Sequence[str]) -> str:
    """Returns what to do about names that a model lacks: the likely ones where there are any."""
    pairs = {name: likely for name in absent if (likely := _likely(name, joints))}
    if not pairs:
        return f"name them as the model does ({some(joints)}), with name = ... in an import mapping"
    listed = ", ".join(f"{name} as {likely}" for name, likely in pairs.items())
    return f"is it {listed}? name them alike, in the model or in the import mapping"


def _likely(name: str, joints: Sequence[str]) -> str:
    """Returns the model's joint that a name may mean, or an empty text."""
    lower = {joint.lower(): joint for joint in joints}
    inside = [joint for low, joint in lower.items() if low in name.lower() or name.lower() in low]
    if len(inside) == 1:
        return inside[0]
    alike = get_close_matches(name.lower(), lower, n=1, cutoff=_ALIKE)
    return lower[alike[0]] if alike else ""


def command_kinds(nominal: NominalModel, files: Files) -> Iterator[Check]:
    """Checks that for every kind of recorded command a model takes it."""
    kinds: dict[CommandKind, list[str]] = {}
    for _, run in files:
        kinds.setdefault(run.command_kind, []).append(run.name)
    for kind, names in kinds.items():
        if kind in nominal.specs:
            yield well(COMMANDS, f"{kind} in {_counted(names)}, as the model's actuators take")
        else:
            taken = " and ".join(sorted(nominal.specs))
            yield refusal(
                COMMANDS,
                f"{kind} in {some(names)}; the model's actuators take {taken}",
                f"give one more --model, whose actuators take {kind} commands",
            )


def _counted(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{len(names)} recordings"


def shared(nominal: NominalModel, files: Files) -> Files:
    """Returns the recordings that models can be asked about, with the joints that all of them have.

    What other checks look at, so that one wrong name does not hide the rest.
    """
    known = _common({joint.name for joint in spec.joints} for spec in nominal.specs.values())
    names = [name for name in files[0][1].joint_names if name in known]
    fitting = [(path, run) for path, run in files if run.command_kind in nominal.specs]
    return [(path, run.with_joints(names)) for path, run in fitting] if names else []


def _common(sets: Iterable[set[str]]) -> set[str]:
    first, *others = sets
    return first.intersection(*others)
