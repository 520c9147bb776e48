"""The same answers as tables for a terminal, readable at 80 columns."""

from __future__ import annotations

from collections.abc import Iterator

from rich import box
from rich.console import Console
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from gfm.diagnosis.output.result import Diagnosis, NamedEffect
from gfm.report import words
from gfm.report.learned_document import learned_sentence
from gfm.report.reveal import EffectCheck, Reveal, reveal
from gfm.report.run import Comparison, ComparisonLine, RunReport, SystemFacts
from gfm.report.transfer import print_transfer

_TONES = {"good": "green", "warn": "yellow", "bad": "red"}
_SUSPECTS_SHOWN = 5


def print_diagnosis(console: Console, diagnosis: Diagnosis) -> None:
    """Prints verdict, effects, errors, the best suspects, and what a reader should know."""
    if diagnosis.changes:
        console.print(
            Panel(Text(diagnosis.changes.sentence), title=" What changed ", title_align="left")
        )
    verdict = words.VERDICTS[diagnosis.verdict]
    title = Text(f" {verdict.title} ", style=f"bold {_TONES[verdict.tone]}")
    console.print(Panel(Text(diagnosis.sentence), title=title, title_align="left"))
    if diagnosis.effects:
        console.print(_effects_table(diagnosis.effects))
    console.print(_error_table(diagnosis))
    if diagnosis.suspects:
        console.print(_suspects_table(diagnosis))
    _print_remarks(console, diagnosis)


def print_run(console: Console, report: RunReport) -> None:
    """Prints the diagnosis, the comparison of the models, the truth and what ran."""
    print_diagnosis(console, report.diagnosis)
    console.print(_comparison_table(report.comparison))
    if report.hidden is not None:
        result = reveal(report.diagnosis.effects, report.hidden)
        console.print(Panel(_reveal_text(result), title=_reveal_title(report), title_align="left"))
    if report.task is not None:
        print_transfer(console, report.task)
    console.print(_system_text(report.system))


def _table(title: str, *columns: str, figures: tuple[str, ...] = ()) -> Table:
    """Returns an empty table; columns of figures never wrap, words fold and so lose nothing."""
    table = Table(
        title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, padding=(0, 1)
    )
    for column in columns:
        is_figure = column in figures
        table.add_column(
            column,
            justify="right" if is_figure else "left",
            overflow="fold",
            no_wrap=is_figure,
        )
    return table


def _effects_table(effects: tuple[NamedEffect, ...]) -> Table:
    figures = ("value", "95 % interval", "confidence")
    table = _table(
        "What the model lacks", "effect", "where", "parameter", *figures, figures=figures
    )
    for effect in effects:
        head = (words.names_title(effect), words.joints_title(effect.joints, effect.effect))
        confidence = words.percent(effect.confidence)
        for name, value, interval in _parameter_lines(effect):
            table.add_row(*map(Text, (*head, name, value, interval, confidence)))
            head, confidence = ("", ""), ""
    return table


def _parameter_lines(effect: NamedEffect) -> Iterator[tuple[str, str, str]]:
    if not effect.parameters:
        yield "", "", ""
    for name, estimate in effect.parameters.items():
        value = words.quantity(estimate.value, estimate.unit)
        yield words.effect_title(name), value, words.interval(estimate)


def _error_table(diagnosis: Diagnosis) -> Table:
    error = diagnosis.error
    columns = ("before", "after", "noise floor", "after/floor")
    title = f"Held-out position error ({error.unit}, RMSE of open-loop rollouts)"
    table = _table(title, "joint", *columns, figures=columns)
    lines = [("all joints", error), *diagnosis.joints.items()]
    if diagnosis.as_measured is not None:
        lines.append(("all, begun as measured", diagnosis.as_measured))
    lines += [(f"object's {k} ({one.unit})", one) for k, one in diagnosis.object_error.items()]
    for head, one in lines:
        figures = (words.number(one.before), words.number(one.after), words.number(one.noise_floor))
        table.add_row(*map(Text, (head, *figures, words.times(one.after, one.noise_floor))))
    return table


def _suspects_table(diagnosis: Diagnosis) -> Table:
    table = _table("What else was considered", "candidate", "why not", "motion that would decide")
    for suspect in diagnosis.suspects[:_SUSPECTS_SHOWN]:
        table.add_row(*map(Text, (words.named(suspect), suspect.reason, suspect.decided_by)))
    left_out = len(diagnosis.suspects) - _SUSPECTS_SHOWN
    if left_out > 0:
        table.caption = f"and {left_out} more in the report"
        table.caption_justify = "left"
    return table


def _print_remarks(console: Console, diagnosis: Diagnosis) -> None:
    if learned := learned_sentence(diagnosis):
        console.print(Text(learned))
    for recording in diagnosis.recordings:
        for warning in recording.warnings:
            console.print(Text(f"! {recording.name}: {warning}", style="yellow"))
    for note in diagnosis.notes:
        console.print(Text(f"* {note}"))


def _comparison_table(comparison: Comparison) -> Table:
    # Five models and their joints have to fit into 80 columns.
    names = (row.model.value.replace("_", "\n+ ") for row in comparison.models)
    columns = (*names, "noise\nfloor")
    title = "Held-out position error by model (rad)"
    table = _table(title, "joint", *columns, figures=columns)
    table.padding = (0, 0, 0, 1)
    for line in comparison.lines():
        cells = (_comparison_cell(line, error) for error in line.errors)
        table.add_row(Text(line.joint), *cells, Text(words.number(line.floor)))
    every = comparison.lines()[0]
    shares = (words.times(error, every.floor) for error in every.errors)
    table.add_section()
    table.add_row("in noise floors", *shares, "1")
    return table


def _comparison_cell(line: ComparisonLine, error: float) -> Text:
    return Text(words.number(error), style="green" if error == line.best else "")


def _reveal_title(report: RunReport) -> str:
    ending = "; the robot here is simulated" if report.simulated else ""
    return f" Revealed after the verdict{ending} "


def _reveal_text(result: Reveal) -> Text:
    text = Text()
    if not result.checks:
        text.append("Nothing was hidden.\n")
    for check in result.checks:
        text.append(f"{_hidden_words(check)}\n")
    text.append("Right effect: ")
    text.append(*_answer(result.names_right))
    text.append("   right place: ")
    text.append(*_answer(result.joints_right))
    if result.surplus:
        surplus = ", ".join(words.named(effect) for effect in result.surplus)
        text.append(f"\nNamed, but not there: {surplus}", style="red")
    return text


def _answer(right: bool) -> tuple[str, str]:
    return ("yes", "bold green") if right else ("no", "bold red")


def _hidden_words(check: EffectCheck) -> str:
    hidden = check.hidden
    parts = [f"{words.effect_title(hidden.effect)} ({words.joints_title(hidden.joints)})"]
    for one in check.parameters:
        truth = words.quantity(one.truth.value, one.truth.unit)
        found = "not named" if one.estimate is None else words.number(one.estimate.value)
        parts.append(f"{words.effect_title(one.name)} {truth} (estimate: {found})")
    return ", ".join(parts)


def _system_text(system: SystemFacts) -> Text:
    counts = {
        "processes": len(system.processes),
        "environment steps": system.env_steps,
        "sequences": system.replay_sequences,
        "learner steps": system.learner_steps,
        "rejected messages": system.rejected_messages,
    }
    phases = (f"{one.name} {words.duration(one.seconds)}" for one in system.phases)
    lines = (
        ", ".join(f"{count:,} {name}" for name, count in counts.items())
        + f", weights version {system.weights_version}",
        ", ".join(phases),
    )
    return Text("\n".join(lines), style="dim")
