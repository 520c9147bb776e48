"""Gives every command bad input, and writes what it says to docs/messages.md.

    python benchmarks/messages.py                # all cases; rewrites the page
    python benchmarks/messages.py --only import  # those of some commands; prints them

Each case runs in an empty folder of its own, as a process of its own, forked from one that has
loaded the commands. A case is good if the command says one line, ends with the status that it
documents, and leaves the folder as it was.
"""

from __future__ import annotations

import argparse
import json
import os
import pkgutil
import re
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))  # small bags and datasets are made there

from bad_inputs import CASES, Case  # noqa: E402

import gfm.api  # noqa: E402
import gfm.experiments  # noqa: E402

PAGE = ROOT / "docs" / "messages.md"
LONGEST_S = 60
#: A line of a service's log.
_LOG = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d+ [A-Z]+ ")
_HEAD = """\
# Messages for bad input

What commands say where they cannot use what they were given: one line that says what was got, what
was expected and where, and exit status 2. Nothing is written then. Every row is a real run, made by
`python benchmarks/messages.py`; `tests/unit/test_messages.py` compares some of them with the code.
Exit status 1 is for what is nobody's input, such as a peer that does not answer. `gfm doctor`
answers with a table of checks on stdout; its rows show what it refuses. What services log
before (lines that begin with a time) is left out.

| command | what was wrong | what it said | status |
|---|---|---|---|
"""


@dataclass(frozen=True, kw_only=True)
class Said:
    """What came of a case.

    Attributes:
        case: Which.
        lines: Of stderr.
        status: With which the command ended.
        left: Files that are there afterwards and were not before.
        answer: Of stdout, where the case asks for JSON.
    """

    case: Case
    lines: tuple[str, ...]
    status: int
    left: tuple[str, ...]
    answer: str

    @property
    def told(self) -> tuple[str, ...]:
        """What it said beside its log; of a doctor, what it refuses, or else says of the model."""
        if not self.answer:
            return tuple(line for line in self.lines if not _LOG.match(line))
        checks = json.loads(self.answer)["checks"]
        refused = [one for one in checks if one["level"] == "refuse"]
        if not refused:
            return tuple(
                f"{one['level']}: {one['found']}" for one in checks if one["name"] == "model"
            )
        return tuple(f"refuse: {one['found']}; {one['advice']}" for one in refused)

    @property
    def good(self) -> bool:
        """Whether it is as a message should be."""
        one_line = bool(self.told) if self.answer else len(self.told) == 1
        return one_line and self.status == self.case.status and not self.left

    @property
    def row(self) -> str:
        """The row of the page."""
        said = " / ".join(self.told).replace("|", "\\|").replace("<", "&lt;")
        return f"| `{self.case.command}` | {self.case.wrong} | {said} | {self.status} |"


def files() -> set[str]:
    """Returns everything in and below the current folder."""
    return {str(path) for path in Path().rglob("*")}


def load_commands() -> None:
    """Imports everything once: each case then starts at once."""
    for package in (gfm.api, gfm.experiments):
        for one in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            import_module(one.name)


def command_of(case: Case) -> tuple[Callable[[list[str]], int], list[str]]:
    """Returns what runs a case's command, and the words with which its arguments begin."""
    program, *words = case.command.split()
    module = "gfm.cli" if program == "gfm" else f"{program.replace('-', '_')}.__main__"
    return import_module(module).main, words


def run(case: Case) -> Said:
    """Runs a case in an empty folder."""
    main, words = command_of(case)
    with (
        _folder(case) as folder,
        tempfile.TemporaryFile("w+") as out,
        tempfile.TemporaryFile("w+") as err,
        chdir(folder),
    ):
        words, before = [*words, *case.words()], files()
        sys.stdout.flush()
        if not (child := os.fork()):
            _be_the_command(main, words, out.fileno(), err.fileno())
        _, status = os.waitpid(child, 0)
        out.seek(0)
        err.seek(0)
        return Said(
            case=case,
            lines=tuple(err.read().strip().splitlines()),
            status=os.waitstatus_to_exitcode(status),
            left=tuple(sorted(files() - before)),
            answer=out.read() if "--json" in words else "",
        )


@contextmanager
def _folder(case: Case) -> Iterator[str]:
    """Yields an empty folder, on a small disk if the case asks for that: only root can make one."""
    with tempfile.TemporaryDirectory() as folder:
        if not case.small_disk:
            yield folder
            return
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", folder], check=True)
        try:
            yield folder
        finally:
            subprocess.run(["umount", folder], check=True)


def _be_the_command(
    main: Callable[[list[str]], int], words: list[str], stdout: int, stderr: int
) -> None:
    """Ends this process as the command does; by a signal if that takes too long."""
    signal.alarm(LONGEST_S)
    os.dup2(stderr, 2)
    os.dup2(stdout, 1)
    try:
        status = main(words)
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 1
    except BaseException:  # noqa: BLE001  (what Python itself does with it)
        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs all cases; returns 1 where one is not as it should be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--only", default="", help="part of a command's name; writes nothing")
    only = parser.parse_args(argv).only
    load_commands()
    told = []
    for case in CASES:
        if only in case.command and (not case.small_disk or os.geteuid() == 0):
            told.append(run(case))
            mark = "  " if told[-1].good else "!!"
            print(mark, told[-1].row, *told[-1].left, flush=True)
    if not only:
        PAGE.write_text(_HEAD + "".join(f"{one.row}\n" for one in told))
    return int(not all(one.good for one in told))


if __name__ == "__main__":
    sys.exit(main())
