"""One HTML file that opens anywhere: template, style, plotly.js and data in it, nothing loaded.

What plots are drawn from is packed, and unpacked by the browser when a plot is first seen: the page
stays below 2 MB, of which plotly.js is nearly all, and opens at once.
"""

from __future__ import annotations

import gzip
import re
from base64 import b85encode
from collections.abc import Mapping
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from gfm.report import chain_document, findings, learned_document, words


def render_page(template: str, **values: object) -> str:
    """Returns the page: `template` of this package, filled with `values`."""
    return render(template, plotly_js=_packed_plotly(), **values)


def render(template: str, **values: object) -> str:
    """Returns `template` of this package, filled with `values`, without anything that draws."""
    return _environment().get_template(template).render(**values)


@cache
def _packed_plotly() -> Markup:
    return packed(get_plotlyjs())


def packed(text: str) -> Markup:
    """Returns a text compressed, in characters that may stand inside a script element.

    By gzip and the digits of RFC 1924 (base 85), "<" and "&" of those replaced by "," and ".";
    `plots.js` unpacks it. A quarter longer than the bytes, where base 64 is a third.
    """
    digits = b85encode(gzip.compress(text.encode(), mtime=0))
    return Markup(digits.translate(bytes.maketrans(b"<&", b",.")).decode())


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
        "names_title": words.names_title,
        "joints_title": words.joints_title,
        "packed_figure": lambda picture: packed(picture.figure.to_json()),
        "code_words": code_words,
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


def code_words(text: str) -> Markup:
    """Returns a text whose words between backticks are set as code."""
    return Markup(re.sub(r"`([^`]*)`", r"<code>\1</code>", str(escape(text))))


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
