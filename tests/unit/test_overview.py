"""A system at a glance, in a terminal and on a page."""

from __future__ import annotations

import base64
import hashlib
import io
import re
from html.parser import HTMLParser

import pytest
from rich.console import Console

from gfm.cli import main
from gfm.core import ManualClock, Status
from gfm.launch import top_command
from gfm.launch.live_page import POLICY, live_page
from gfm.launch.overview import Look, Onlooker, Row, rows
from gfm.launch.survey import Missing
from gfm.launch.top_command import table, watch
from gfm.launch.web import application
from gfm.transport import MemoryHub, MemoryTransport


def actor(steps: int, *, pid: int = 1, name: str = "a-0", note: str = "acting") -> Status:
    return Status(
        role="actor",
        name=name,
        pid=pid,
        host="h",
        counters={"env_steps": steps, "rejected_messages": 2},
        gauges={"weights_age_s": 1.25, "memory_mib": 60.4, "open_files": 9.0},
        note=note,
    )


def look(at_s: float, *found: Status, missing: list[Missing] | None = None) -> Look:
    return Look(at_s=at_s, found=found, missing=missing)


def test_what_was_done_since_the_look_before_is_told_per_second():
    (row,) = rows(look(12.0, actor(700)), look(10.0, actor(300)))
    assert row == Row(
        role="actor",
        name="a-0",
        host="h",
        done=700,
        unit="steps",
        per_s=200.0,
        refused=2,
        memory_mib=60.4,
        open_files=9.0,
        state="weights 1.2 s old",
        note="acting",
    )


@pytest.mark.parametrize(
    "before",
    [None, look(10.0), look(10.0, actor(300, pid=2)), look(10.0, actor(800)), look(12.0, actor(1))],
    ids=["first look", "was away", "another process", "began anew", "no time passed"],
)
def test_no_rate_is_told_where_none_is_known(before):
    (row,) = rows(look(12.0, actor(700)), before)
    assert row.per_s is None


def test_who_is_missing_has_a_row_and_who_ails_says_why():
    absent = Missing(role="learner", name="learner", since_s=1.0, why="ended by signal 9")
    hangs = Missing(role="actor", name="a-0", since_s=1.0, why="no beat for 9 s")
    found = rows(look(1.0, actor(1), missing=[absent, hangs]), None)
    assert [(row.name, row.note, row.is_well) for row in found] == [
        ("a-0", "no beat for 9 s", False),
        ("learner", "ended by signal 9", False),
    ]


def test_a_service_whose_work_is_not_counted_has_a_row():
    (row,) = rows(look(1.0, Status(role="router", name="r", pid=1, host="h")), None)
    assert (row.done, row.unit, row.per_s, row.memory_mib) == (None, "", None, None)


def printed(found: list[Row]) -> str:
    console = Console(file=io.StringIO(), width=160, color_system=None)
    console.print(table(found))
    return console.file.getvalue()


def test_the_terminal_shows_every_row_and_takes_no_orders_from_notes():
    text = printed(rows(look(2.0, actor(1_700, note="[bold]x[/]")), look(1.0, actor(300))))
    assert re.search(r"a-0 .*1,700 steps .*1,400\.0 .* 2 .*60 .*9 .*weights 1\.2 s old", text)
    assert "[bold]x[/]" in text
    assert "nobody answers" in printed([])


def test_it_looks_once_a_period_until_it_is_told_to_stop():
    clock = ManualClock(0)
    console = Console(file=io.StringIO(), width=120, force_terminal=True)
    onlooker = Onlooker(MemoryTransport(MemoryHub(), clock=clock), clock, timeout_s=0.0)
    watch(onlooker, 1.0, clock, lambda: clock.now_ns() >= 3 * 10**9, console)
    assert console.file.getvalue().count("nobody answers") == 3


def test_top_is_for_terminals_and_its_period_is_positive(capsys):
    assert main(["top"]) == 2
    assert capsys.readouterr().err == (
        "error: gfm top needs a terminal; `gfm status --json` is for programs\n"
    )
    assert main(["top", "--period-s", "0"]) == 2
    assert capsys.readouterr().err == "error: --period-s is 0, expected more than 0\n"


def test_top_where_no_system_is_says_so(capsys, monkeypatch):
    monkeypatch.setattr(top_command, "_JOIN_S", 0.0)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    assert main(["top", "--connect", "tcp/127.0.0.1:9"]) == 2
    assert "no system at tcp/127.0.0.1:9: start one with `gfm up`" in capsys.readouterr().err


class Elements(HTMLParser):
    """What a page is made of."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data


def test_the_page_loads_nothing_and_fits_a_phone():
    page = Elements(live_page(rows(look(2.0, actor(700)), look(1.0, actor(300))), "default"))
    assert not [tag for tag, given in page.found if given.keys() & {"src", "href", "action"}]
    assert ("meta", {"name": "viewport", "content": "width=device-width, initial-scale=1"}) in (
        page.found
    )
    assert "1 of 1 processes are well" in page.text
    assert "400.0 steps/s" in page.text
    assert "refused 2 messages" in page.text


def test_the_page_shows_what_others_say_as_text():
    evil = "<script>alert(1)</script>"
    page = Elements(live_page([Row(role="actor", name=evil, note=evil, state=evil)], evil))
    assert sum(tag == "script" for tag, _ in page.found) == 1
    assert page.text.count(evil) == 5


def test_the_page_s_policy_allows_its_own_script_and_style_and_no_other():
    page = live_page([], "default")
    for tag in ("script", "style"):
        (text,) = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in POLICY
    assert "unsafe" not in POLICY
    assert POLICY.startswith("default-src 'none'")


@pytest.mark.parametrize(
    ("path", "method", "status"),
    [("/", "GET", "200"), ("/", "POST", "404"), ("/x", "GET", "404"), ("/metrics", "GET", "200")],
)
def test_what_is_asked_for_is_answered_and_nothing_else(path, method, status):
    said = []

    def metrics(_environ, start):
        start("200 OK", [])
        return [b"numbers"]

    answer = application(metrics, lambda: "page")(
        {"PATH_INFO": path, "REQUEST_METHOD": method}, lambda *words: said.append(words)
    )
    ((line, headers),) = said
    assert line.startswith(status)
    if status == "200":
        assert b"".join(answer) == (b"numbers" if path == "/metrics" else b"page")
    if (path, status) == ("/", "200"):
        assert ("Content-Security-Policy", POLICY) in headers
