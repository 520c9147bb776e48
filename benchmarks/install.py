"""Measures an installation from nothing: time, size, and how long commands take to begin.

    python benchmarks/install.py --page docs/results/install.md

Each installation is a new environment in a temporary folder, filled by pip from where it is set up
to take packages from, without its cache.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

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
_SHOWN = 12


@dataclass(frozen=True, kw_only=True)
class Installation:
    """What an installation takes.

    Attributes:
        name: In a word.
        extras: Of the package.
        took_s: pip.
        megabytes: Of everything that was installed, by package folder; pip itself is not counted.
        import_s: `import gfm` in a new process, the interpreter's own start taken off; best of 7.
        help_s: `gfm --help`, whole; best of 7.
    """

    name: str
    extras: tuple[str, ...]
    took_s: float
    megabytes: dict[str, float]
    import_s: float
    help_s: float

    @property
    def total_mb(self) -> float:
        """Size of all of it."""
        return sum(self.megabytes.values())


def measured(name: str, folder: Path) -> Installation:
    """Installs into a new environment in a folder."""
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python, extras = folder / "bin" / "python", EXTRAS[name]
    pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check", "install"]
    began = time.monotonic()
    subprocess.run([*pip, "--no-cache-dir", f"{ROOT}[{','.join(extras)}]"], check=True)
    took_s = time.monotonic() - began
    nothing_s = fastest_s([str(python), "-c", ""])
    return Installation(
        name=name,
        extras=extras,
        took_s=took_s,
        megabytes=sizes_mb(next((folder / "lib").glob("python*/site-packages"))),
        import_s=fastest_s([str(python), "-c", "import gfm"]) - nothing_s,
        help_s=fastest_s([str(folder / "bin" / "gfm"), "--help"]),
    )


def fastest_s(words: Sequence[str]) -> float:
    """Returns the least time of several runs: what is more is other work on the machine."""
    # Else the code under test would be what lies on the path, not what was installed.
    plain = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    took = []
    for _ in range(_TRIES):
        began = time.monotonic()
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, env=plain)
        took.append(time.monotonic() - began)
    return min(took)


def sizes_mb(packages: Path) -> dict[str, float]:
    """Returns the size of what lies in a folder, largest first, without pip."""
    sizes = {
        one.name: sum(file.stat().st_size for file in (*one.rglob("*"), one) if file.is_file())
        for one in packages.iterdir()
        if one.name.partition("-")[0] != "pip"
    }
    ordered = sorted(sizes.items(), key=lambda pair: -pair[1])
    return {name: size / 1e6 for name, size in ordered}


def page(installations: Sequence[Installation]) -> str:
    """Returns the page of results."""
    rows = [
        f"| {one.name} | `{','.join(one.extras)}` | {one.total_mb:.0f} | {one.took_s:.0f} "
        f"| {one.import_s:.2f} | {one.help_s:.2f} |"
        for one in installations
    ]
    asked = f"| asked of the core | | {MOST_MB} | {MOST_S} | {MOST_IMPORT_S} | {MOST_HELP_S} |"
    parts = "\n".join(_largest(one) for one in installations)
    return f"""# What an installation takes

A new environment, filled by `pip install 'gfm-sim2real[EXTRAS]'` without a cache, on
{platform.machine()} with Python {platform.python_version()} beside other work,
{time.strftime("%Y-%m-%d")}, at commit {commit()}:

    python benchmarks/install.py --page docs/results/install.md

| | extras | MB | pip, s | `import gfm`, s | `gfm --help`, s |
|---|---|---|---|---|---|
{chr(10).join(rows)}
{asked}

The core diagnoses, imports tables (CSV, JSON, NumPy) and writes reports. `formats` adds Parquet
and LeRobot, MATLAB 7.3 and ROS bags. pip's time is that of this machine's line; times of commands
are the least of {_TRIES}, for what is more is other work.
{parts}"""


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
        arguments.page.write_text(text)
    core = made[0]
    kept = (
        core.total_mb <= MOST_MB,
        core.took_s <= MOST_S,
        core.import_s <= MOST_IMPORT_S,
        core.help_s <= MOST_HELP_S,
    )
    return int(not all(kept))


if __name__ == "__main__":
    sys.exit(main())
