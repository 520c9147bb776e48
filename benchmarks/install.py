"""Measures an installation from nothing: time, size, and how long commands take to begin.

    python benchmarks/install.py --page docs/results/install.md

Each installation is a new environment in a temporary folder, filled by pip from where it is set up
to take packages from, without its cache: first all wheels are fetched or built, then installed.
What the page says of what could be dropped is written by hand, and stays.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from effects_10_seeds import commit

ROOT = Path(__file__).parents[1]
#: What is installed, by a word: the diagnosis with what it reads and writes, and other formats.
EXTRAS = {
    "core": ("recording", "simulation", "report"),
    "core and formats": ("recording", "simulation", "report", "formats"),
}
#: What is asked of the core.
MOST_MB, MOST_S, MOST_IMPORT_S, MOST_HELP_S = 250, 60, 0.5, 0.3
_TRIES = 7
_BY_HAND = "\n## What could be dropped\n"
_SHOWN = 12


class Took(NamedTuple):
    """The least of several runs: what is more is other work on the machine.

    Attributes:
        wall_s: By the clock.
        cpu_s: Of a processor.
    """

    wall_s: float
    cpu_s: float

    @property
    def text(self) -> str:
        """Both, for a table."""
        return f"{self.wall_s:.2f} ({self.cpu_s:.2f})"


@dataclass(frozen=True, kw_only=True)
class Installation:
    """What an installation takes.

    Attributes:
        name: In a word.
        extras: Of the package.
        took_s: pip, for wheels and their installation.
        wheels_mb: Of all wheels: what goes over the line.
        megabytes: Of everything that was installed, by package folder; what an empty environment
            has (pip, up to Python 3.11 setuptools) is not counted.
        imported: `import gfm` in a new process, without the interpreter's own start.
        helped: `gfm --help`, whole.
    """

    name: str
    extras: tuple[str, ...]
    took_s: float
    wheels_mb: float
    megabytes: dict[str, float]
    imported: Took
    helped: Took

    @property
    def total_mb(self) -> float:
        """Size of all of it."""
        return sum(self.megabytes.values())


def measured(name: str, folder: Path) -> Installation:
    """Installs into a new environment in a folder."""
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python, extras = folder / "bin" / "python", EXTRAS[name]
    packages = next((folder / "lib").glob("python*/site-packages"))
    empty = {one.name for one in packages.iterdir()}
    pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check"]
    wheels, asked = folder / "wheels", f"[{','.join(extras)}]"
    began = time.monotonic()
    subprocess.run(
        [*pip, "wheel", "--no-cache-dir", "--wheel-dir", str(wheels), f"{ROOT}{asked}"], check=True
    )
    from_there = ["--no-index", "--find-links", str(wheels)]
    subprocess.run([*pip, "install", *from_there, f"gfm-sim2real{asked}"], check=True)
    took_s = time.monotonic() - began
    nothing, whole = (fastest([str(python), "-c", code]) for code in ("", "import gfm"))
    return Installation(
        name=name,
        extras=extras,
        took_s=took_s,
        wheels_mb=sum(one.stat().st_size for one in wheels.iterdir()) / 1e6,
        megabytes=sizes_mb(packages, empty),
        imported=Took(whole.wall_s - nothing.wall_s, whole.cpu_s - nothing.cpu_s),
        helped=fastest([str(folder / "bin" / "gfm"), "--help"]),
    )


def fastest(words: Sequence[str]) -> Took:
    """Returns what a command takes."""
    # Else the code under test would be what lies on the path, not what was installed.
    plain = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    wall_s, cpu_s = [], []
    for _ in range(_TRIES):
        began, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, env=plain)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        wall_s.append(time.monotonic() - began)
        cpu_s.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return Took(min(wall_s), min(cpu_s))


def sizes_mb(packages: Path, without: Collection[str]) -> dict[str, float]:
    """Returns the size of what lies in a folder, largest first, without what is named."""
    sizes = {
        one.name: sum(file.stat().st_size for file in (*one.rglob("*"), one) if file.is_file())
        for one in packages.iterdir()
        if one.name not in without
    }
    ordered = sorted(sizes.items(), key=lambda pair: -pair[1])
    return {name: size / 1e6 for name, size in ordered}


def page(installations: Sequence[Installation]) -> str:
    """Returns the page of results."""
    core = installations[0]
    rows = [
        f"| {one.name} | `{','.join(one.extras)}` | {one.wheels_mb:.0f} | {one.total_mb:.0f} "
        f"| {one.took_s:.0f} "
        f"| {one.imported.text} | {one.helped.text} |"
        for one in installations
    ]
    asked = f"| asked of the core | | | {MOST_MB} | {MOST_S} | {MOST_IMPORT_S} | {MOST_HELP_S} |"
    parts = "\n".join(_largest(one) for one in installations)
    return f"""# What an installation takes

A new environment, filled by pip without a cache (first all wheels, then from these), on
{platform.machine()} with Python {platform.python_version()} beside other work, \
{time.strftime("%Y-%m-%d")}, at commit {commit()}:

    python benchmarks/install.py --page docs/results/install.md

| | extras | MB of wheels | MB installed | pip, s | `import gfm`, s | `gfm --help`, s |
|---|---|---|---|---|---|---|
{chr(10).join(rows)}
{asked}

So {core.wheels_mb:.0f} MB go over the line, and {core.total_mb:.0f} MB lie on the disk.

The core diagnoses, imports tables (CSV, JSON, NumPy) and writes reports; it has neither torch nor
zenoh. `lerobot` adds LeRobot datasets and Parquet, `formats` MATLAB 7.3 and ROS bags as well,
`learn` what `gfm fit` and `gfm train` start. Times are by the clock and, in brackets, of a
processor, each the least of {_TRIES}: the rest is waiting for other work.
{parts}"""


def with_words(text: str, old: str) -> str:
    """Returns a page with what was written by hand at the end of the old one."""
    return text + "".join(old.partition(_BY_HAND)[1:])


def _largest(one: Installation) -> str:
    shown = list(one.megabytes.items())[:_SHOWN]
    rest = one.total_mb - sum(size for _, size in shown)
    rows = "\n".join(f"| {name} | {size:.1f} |" for name, size in shown)
    return f"""
## Where the size of {one.name} is

| folder | MB |
|---|---|
{rows}
| all others | {rest:.1f} |
"""


def main() -> int:
    """Measures; returns 1 where the core takes more than is asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--only", choices=EXTRAS)
    parser.add_argument("--page", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    made = []
    for name in EXTRAS if arguments.only is None else [arguments.only]:
        with tempfile.TemporaryDirectory() as folder:
            made.append(measured(name, Path(folder) / "venv"))
    text = page(made)
    print(text)
    if arguments.page is not None:
        old = arguments.page.read_text() if arguments.page.exists() else ""
        arguments.page.write_text(with_words(text, old))
    core = made[0]
    kept = (
        core.total_mb <= MOST_MB,
        core.took_s <= MOST_S,
        core.imported.wall_s <= MOST_IMPORT_S,
        core.helped.wall_s <= MOST_HELP_S,
    )
    return int(not all(kept))


if __name__ == "__main__":
    sys.exit(main())
