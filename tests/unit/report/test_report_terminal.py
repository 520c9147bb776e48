"""The tables in a terminal."""

import io

import pytest
from rich.console import Console

from gfm.diagnosis.output.result import ErrorSummary, NamedEffect, Suspect, Verdict
from gfm.effects import Placed
from gfm.report import print_diagnosis, print_run
from gfm.report.document import diagnosis_html


def printed(show, value, width=80):
    console = Console(file=io.StringIO(), width=width)
    show(console, value)
    return console.file.getvalue()


@pytest.mark.parametrize("verdict", list(Verdict))
def test_every_verdict_is_named(diagnosis_with, verdict):
    text = printed(print_diagnosis, diagnosis_with(verdict=verdict))
    assert verdict.value.replace("_", " ") in text.lower()


def test_nothing_is_wider_than_80_columns_or_cut_off(run_with):
    text = printed(print_run, run_with())
    assert max(map(len, text.splitlines())) <= 80
    for figure in ("1.27 … 1.37", "1.32 N m", "0.00752", "29.3 ×", "estimate: 1.32"):
        assert figure in text


def test_errors_as_measured_have_a_line_where_they_are_known(diagnosis_with):
    begun = ErrorSummary(before=0.25, after=0.0625, noise_floor=0.0125)
    text = printed(print_diagnosis, diagnosis_with(as_measured=begun))
    (line,) = (one for one in text.splitlines() if "begun as measured" in one)
    assert "0.250" in line
    assert "0.0625" in line
    assert "begun as measured" not in printed(print_diagnosis, diagnosis_with())


def test_a_long_joint_name_is_folded_not_cut(diagnosis_with):
    name = "left_hind_leg_" * 8
    joint = ErrorSummary(before=1.0, after=0.5, noise_floor=0.1)
    text = printed(print_diagnosis, diagnosis_with(joints={name: joint}))
    assert max(map(len, text.splitlines())) <= 80
    assert "".join(text.split()).count("left_hind_leg_") >= 1
    assert "…" not in text.split("after/floor")[1].split("What else")[0]


def test_square_brackets_in_names_are_no_markup(diagnosis_with):
    suspect = Suspect(effect="[bold]x[/bold]", joints=("[/red]",), reason="[link=x]")
    text = printed(print_diagnosis, diagnosis_with(suspects=(suspect,), sentence="[blink]s"))
    assert "[bold]x[/bold]" in text
    assert "[/red]" in text
    assert "[blink]s" in text


def test_an_effect_without_parameters_still_has_its_line(diagnosis_with):
    effect = NamedEffect(
        effect="mystery", joints=(), parameters={}, confidence=float("nan"), native=True
    )
    text = printed(print_diagnosis, diagnosis_with(effects=(effect,)))
    assert "mystery" in text
    assert "whole robot" in text


def test_names_that_are_not_told_apart_stand_together(diagnosis_with):
    effect = NamedEffect(
        effect="lag",
        joints=("j",),
        parameters={},
        confidence=0.9,
        native=True,
        equals=(Placed(effect="delay", joints=("j",)),),
    )
    diagnosis = diagnosis_with(effects=(effect,))
    assert "lag or delay" in " ".join(printed(print_diagnosis, diagnosis).split())
    assert diagnosis_html(diagnosis).count("lag or delay") == 2  # on its card and in the table


def test_only_the_best_suspects_are_listed_and_the_rest_counted(diagnosis_with):
    suspects = tuple(Suspect(effect=f"s{i}", joints=(), reason="r") for i in range(8))
    text = printed(print_diagnosis, diagnosis_with(suspects=suspects))
    assert "s4" in text
    assert "s5" not in text
    assert "and 3 more in the report" in text


def test_the_truth_stands_below_the_verdict(run_with):
    text = printed(print_run, run_with())
    assert text.index("Explained") < text.index("Revealed after the verdict")
    assert "the robot here is simulated" in text


def test_without_a_sealed_file_nothing_is_revealed(run_with):
    assert "Revealed" not in printed(print_run, run_with(hidden=None))


def test_warnings_and_notes_are_printed(diagnosis_with):
    text = printed(print_diagnosis, diagnosis_with())
    assert "! heldout_velocity_0.mcap: 3 gaps" in text
    assert "* Record slow reversals" in text
