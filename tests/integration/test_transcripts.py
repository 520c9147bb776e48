"""The ways from files to a verdict that the documentation shows are those that are gone here."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from foreign import Sources
from transcripts import PAGE, WAYS, Said, Way, gone, section, typed, with_section

#: What the page says that was typed.
TYPED = re.compile(r"^\$ (.+)$", re.MULTILINE)
#: A diagnosis ends at once: that it reaches a verdict is what counts here.
SHORT = " --minutes 0.02 --no-film"
VERDICTS = ("Explained", "Partly explained", "Unexplained", "No gap", "Insufficient data")


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_the_page_types_what_the_way_says(way: Way) -> None:
    part = PAGE.read_text().partition(f"\n## {way.title}\n")[2].partition("\n## ")[0]
    said = [command for command in TYPED.findall(part) if command != "ls"]
    assert said == list(way.commands)


def test_a_part_of_the_page_takes_the_place_of_the_old_one() -> None:
    first, second, third, *_ = WAYS
    page = "head\n" + "".join(f"\n## {way.title}\n\nold {way.name}\n" for way in WAYS)
    lines = "\n".join(f"line {i}" for i in range(100))
    said = [Said(command=command, text=lines, status=0, took_s=2.0) for command in ("ls", "gfm")]
    for way in (second, third):
        page = with_section(page, way, section(way, said))
    assert page.startswith(f"head\n\n## {first.title}\n\nold {first.name}\n\n## {second.title}\n")
    assert [way.title for way in WAYS] == re.findall("^## (.+)$", page, re.MULTILINE)
    assert page.count("... 50 more lines ...") == 4
    with pytest.raises(SystemExit, match="no part"):
        with_section("head\n", first, "")


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_a_way_has_at_most_three_commands_and_no_editor(way: Way) -> None:
    assert len(way.commands) <= 3
    assert all(command.startswith("gfm ") for command in way.commands)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_a_way_reaches_a_verdict_on_short_recordings(way: Way, tmp_path: Path, data: Path) -> None:
    imported, diagnosed = way.commands
    way.make(tmp_path, Sources(data=data, longest_s=2.5, most=2))
    first = typed(imported, tmp_path)
    assert first.status == 0, first.text
    last = typed(diagnosed + SHORT, tmp_path)
    assert last.status == 0, last.text
    assert any(verdict in last.text for verdict in VERDICTS), last.text
    assert (tmp_path / "diagnosis" / "report.html").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_a_whole_way_ends_well(way: Way, tmp_path: Path, data: Path) -> None:
    said = gone(way, tmp_path, Sources(data=data, most=way.recordings))
    assert [one.status for one in said] == [0] * (1 + len(way.commands)), said[-1].text
    assert any(verdict in said[-1].text for verdict in VERDICTS)
