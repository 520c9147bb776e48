"""A running system as one small page: made here, loads nothing from elsewhere, reads on a phone.

The page asks for itself again every other second and puts what is new in the place of what was;
without scripts the browser loads it anew instead.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from html import escape

from gfm.launch.overview import Row

_STYLE = """
:root { color-scheme: light dark; font: 16px/1.4 system-ui, sans-serif; }
body { margin: 0 auto; padding: 1rem; max-width: 60rem; }
h1 { font-size: 1.1rem; margin: 0 0 .2rem; }
p { margin: 0 0 .8rem; opacity: .75; }
ul { display: grid; grid-template-columns: repeat(auto-fill, minmax(17rem, 1fr)); gap: .6rem;
     list-style: none; margin: 0; padding: 0; }
li { border: 1px solid #8886; border-left: .4rem solid #2a8; border-radius: .4rem;
     padding: .5rem .7rem; overflow-wrap: anywhere; }
li.bad { border-left-color: #d33; }
b { font-weight: 600; }
.rate { float: right; font-variant-numeric: tabular-nums; }
small { display: block; opacity: .75; font-variant-numeric: tabular-nums; }
.refused { color: #d33; opacity: 1; }
.stale main { opacity: .4; }
"""

_SCRIPT = """
async function again() {
  try {
    const answer = await fetch(location.href, { cache: "no-store" });
    if (!answer.ok) throw new Error(answer.status);
    const page = new DOMParser().parseFromString(await answer.text(), "text/html");
    document.querySelector("main").replaceWith(page.querySelector("main"));
    document.body.classList.remove("stale");
  } catch {
    document.body.classList.add("stale");
  }
  setTimeout(again, 2000);
}
setTimeout(again, 2000);
"""


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


POLICY = (
    f"default-src 'none'; connect-src 'self'; style-src {_hash(_STYLE)}; "
    f"script-src {_hash(_SCRIPT)}; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
"""Content-Security-Policy of the page: its own style and script, and nothing else at all."""


def live_page(rows: Sequence[Row], run: str) -> str:
    """Returns the page.

    Args:
        rows: One per process.
        run: The run's name.
    """
    title = escape(f"gfm: {run}")
    ailing = sum(not row.is_well for row in rows)
    sums = f"{len(rows) - ailing} of {len(rows)} processes are well" if rows else "nobody answers"
    cards = "".join(_card(row) for row in rows)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<noscript><meta http-equiv="refresh" content="2"></noscript>'
        f"<style>{_STYLE}</style></head><body><main><h1>{title}</h1><p>{sums}</p>"
        f"<ul>{cards}</ul></main><script>{_SCRIPT}</script></body></html>"
    )


def _card(row: Row) -> str:
    rate = "" if row.per_s is None else f'<span class="rate">{row.per_s:,.1f} {row.unit}/s</span>'
    done = "" if row.done is None else f"{row.done:,} {row.unit}"
    memory = "" if row.memory_mib is None else f"{row.memory_mib:,.0f} MiB"
    files = "" if row.open_files is None else f"{row.open_files:.0f} files"
    numbers = ", ".join(word for word in (done, memory, files) if word)
    lines = [escape(word) for word in (numbers, row.state, row.note) if word]
    refused = f"refused {row.refused:,} messages" if row.refused else ""
    return (
        f"<li{'' if row.is_well else ' class=bad'}>{rate}<b>{escape(row.name)}</b>"
        + "".join(f"<small>{line}</small>" for line in lines)
        + (f'<small class="refused">{refused}</small>' if refused else "")
        + "</li>"
    )
