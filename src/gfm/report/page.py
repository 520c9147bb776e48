"""One HTML file that opens anywhere: template, style, plotly.js and data in it, nothing loaded."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from gfm.report import chain_document, findings, learned_document, words
from gfm.report.figures import Picture


def render_page(template: str, **values: object) -> str:
    """Returns the page: `template` of this package, filled with `values`."""
    return _environment().get_template(template).render(plotly_js=Markup(get_plotlyjs()), **values)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("gfm.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": words.number,
        "percent": words.percent,
        "duration": words.duration,
        "interval": words.interval,
        "effect_title": words.effect_title,
        "effect_law": words.effect_law,
        "joints_title": words.joints_title,
        "figure_json": _figure_json,
        "flat": flat,
        "gathered": findings.gathered,
        "finding_amount": findings.finding_amount,
        "some": words.some,
        "adequacy_sentence": chain_document.adequacy_sentence,
        "agreement": chain_document.agreement_words,
        "amounts_sentence": chain_document.amounts_sentence,
        "delays_found": findings.delays_found,
        "doubts_found": findings.doubts_found,
        "energy_sentence": chain_document.energy_sentence,
        "both_say": learned_document.both_say,
        "learned_sentence": learned_document.learned_sentence,
        "hundredths": chain_document.hundredths,
        "goes_with": chain_document.goes_with,
    }
    environment.globals |= {
        "times": words.times,
        "quantity": words.quantity,
        "false_alarms_sentence": chain_document.false_alarms_sentence,
    }
    return environment


def _figure_json(picture: Picture) -> Markup:
    """Returns the figure as JSON that may stand inside a script element.

    plotly writes `<`, `>` and `/` as unicode escapes, so no text in it can close the element.
    """
    return Markup(picture.figure.to_json())


def flat(values: Mapping[str, object], prefix: str = "") -> list[tuple[str, str]]:
    """Returns nested values as lines of a table, "a.b" for b inside a."""
    lines: list[tuple[str, str]] = []
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            lines += flat(value, f"{name}.")
        elif isinstance(value, list | tuple):
            lines.append((name, ", ".join(str(one) for one in value) or words.NOTHING))
        else:
            lines.append((name, words.NOTHING if value is None else str(value)))
    return lines
