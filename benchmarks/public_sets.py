"""gfm-bench: what diagnoses and peers make of public recordings of measured robots.

    git clone https://github.com/OWNER/NAME clones/OWNER/NAME     # of each set that is asked for
    python benchmarks/public_sets.py --clones clones --minutes 3 --peers

Recordings stay where they were published: every file is read from a clone, at a commit, and has
the hash that its set says. Answers that are there already are not asked for again.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from diagnosis import LIMIT_S, PEER, PEER_PACKAGES, run_python
from effects_10_seeds import commit
from peer import PEERS
from public import SETS, PublicSet
from public.judge import Judged, judged, table
from public.source import Clones

import gfm
from gfm.recording import write_recording

GFM = "gfm"
#: Peers that turn everything at once are broken off after that long, s.
PEER_LIMIT_S = 300


def write_case(one: PublicSet, clones: Clones, folder: Path) -> Path:
    """Writes a set as a case (model.xml, train_*.mcap, held_*.mcap); returns its folder."""
    case = folder / "cases" / one.name
    if not case.exists():
        read = one.reader(clones)
        recordings, model = one.recordings(read), one.model(read)
        case.mkdir(parents=True)
        (case / "model.xml").write_text(model)
        for recording in recordings:
            part = "held" if recording.name in one.held_out else "train"
            write_recording(case / f"{part}_{recording.name}.mcap", recording)
    return case


def ask(who: str, case: Path, out: Path, minutes: float) -> None:
    """Asks gfm or a peer about a case, in a process of its own, unless it was asked."""
    if (out / "made.json").exists():
        return
    out.mkdir(parents=True, exist_ok=True)
    began, cpu_began_s = time.monotonic(), _cpu_s()
    if who == GFM:
        told = ["--model", str(case / "model.xml"), "--out", str(out / "diagnosis")]
        held = ["--holdout", *map(str, sorted(case.glob("held_*.mcap")))]
        training = map(str, sorted(case.glob("train_*.mcap")))
        words = ["diagnose", *training, *told, *held, "--no-film", "--minutes", f"{minutes:g}"]
        status = run_python(["-m", "gfm.cli", *words], out / "log", LIMIT_S, {})
    else:
        words = [str(PEER), "--peer", who, "--case", str(case), "--out", str(_report(who, out))]
        more = {"PYTHONPATH": _with_peers()}
        status = run_python(words, out / "log", PEER_LIMIT_S, more)
    made = {
        "wall_s": time.monotonic() - began,
        "cpu_s": _cpu_s() - cpu_began_s,
        "commit": commit(),
        "status": status,
    }
    (out / "made.json").write_text(json.dumps(made))


def _cpu_s() -> float:
    """Returns the processor time of all processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _with_peers() -> str:
    return os.pathsep.join(filter(None, (os.environ.get("PYTHONPATH"), str(PEER_PACKAGES))))


def _report(who: str, out: Path) -> Path:
    return out / "diagnosis" / "report.json" if who == GFM else out / "report.json"


def answer(one: PublicSet, who: str, out: Path) -> Judged | None:
    """Returns what an answer is worth; None where there is none."""
    if not _report(who, out).exists():
        return None
    made = json.loads((out / "made.json").read_text())
    report = json.loads(_report(who, out).read_text())
    return judged(one, who, report, wall_s=made["wall_s"], cpu_s=made["cpu_s"])


def page(sets: Sequence[PublicSet], answers: Sequence[Judged], silent: Sequence[str]) -> str:
    """Returns the page of results."""
    rows = [
        f"| {one.name} | {one.robot} | [{one.repository.name}](https://github.com/"
        f"{one.repository.name}) @ {one.repository.commit[:8]} | {one.repository.licence} "
        f"| {len(one.files)} | {one.note} |"
        for one in sets
    ]
    told = f"\n\nNo answer: {'; '.join(silent)}." if silent else ""
    return "\n".join(
        [
            "| set | robot | source | licence | files | what is known |",
            "|---|---|---|---|---|---|",
            *rows,
            "",
            "## Answers",
            "",
            table(answers) + told,
            "",
        ]
    )


def main() -> None:
    """Asks everybody about the sets that are asked for, and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--clones", type=Path, required=True, metavar="DIR")
    parser.add_argument("--set", action="append", choices=[one.name for one in SETS], dest="sets")
    parser.add_argument("--minutes", type=float, default=10.0, help="for each diagnosis")
    parser.add_argument("--peers", action="store_true", help="ask them, too")
    parser.add_argument("--out", type=Path, default=Path("runs/public"), metavar="DIR")
    parser.add_argument("--page", type=Path, metavar="FILE", help="where the tables go")
    arguments = parser.parse_args()
    sets = [one for one in SETS if arguments.sets is None or one.name in arguments.sets]
    asked = [GFM, *PEERS] if arguments.peers else [GFM]
    answers, silent = [], []
    for one in sets:
        case = write_case(one, Clones(folder=arguments.clones), arguments.out)
        for who in asked:
            out = arguments.out / "answers" / one.name / who
            ask(who, case, out, arguments.minutes)
            found = answer(one, who, out)
            if found is None:
                silent.append(f"{who} on {one.name}")
            else:
                answers.append(found)
                print(table([found]).splitlines()[-1], flush=True)
    made = (
        f"gfm {gfm.__version__} at {commit()}, {time.strftime('%Y-%m-%d')}, Python "
        f"{platform.python_version()}, MuJoCo {version('mujoco')}, {arguments.minutes:g} minutes "
        "a diagnosis, one core"
    )
    tables = f"{page(sets, answers, silent)}\nMade with {made}.\n"
    print(tables)
    if arguments.page is not None:
        arguments.page.write_text(tables)


if __name__ == "__main__":
    main()
