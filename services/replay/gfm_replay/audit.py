"""Whether a replay's folder holds what its actors were told has arrived: once each, unchanged.

    python -m gfm_replay.audit --folder runs/up-1/replay --ledgers runs/up-1/ledgers

The service must not be running: it alone may have its folder open. Exit status 1 where something is
lost, doubled or changed.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from gfm.core import SEQUENCE_ARRAYS, BadInputError, arrays_checksum
from gfm.parser import OneLineParser
from gfm.service import exit_status
from gfm.service.ledger import read_ledgers
from gfm_replay.journal import Journal, Kept


@dataclass(frozen=True, kw_only=True)
class Audit:
    """What became of the sequences of all actors.

    Attributes:
        lives: Of actors that were told of something.
        acknowledged: By the actors' ledgers.
        kept: In the folder; more than the ledgers have, where an actor was killed before it heard.
        evicted: Made room for newer ones.
        lost: Acknowledged, and neither kept nor evicted. Which ones were evicted is not known, so
            that it is a lower bound unless `evicted` is 0.
        doubled: Kept more than once.
        changed: Kept with other values than were sent.
    """

    lives: int
    acknowledged: int
    kept: int
    evicted: int
    lost: int
    doubled: int
    changed: int

    @property
    def is_sound(self) -> bool:
        """Whether nothing was lost, doubled or changed."""
        return not (self.lost or self.doubled or self.changed)


def audit(ledgers: Mapping[tuple[str, int], Mapping[int, int]], kept: Kept) -> Audit:
    """Returns what became of the sequences.

    Args:
        ledgers: Checksums by number, by actor and epoch, as `read_ledgers` returns them.
        kept: What the folder holds.
    """
    records = kept.records
    checksums = [arrays_checksum(record[name] for name in SEQUENCE_ARRAYS) for record in records]
    actors = [actor.decode() for actor in records["actor"].tolist()]
    numbers = zip(actors, records["epoch"].tolist(), records["number"].tolist(), strict=True)
    found = list(zip(numbers, checksums, strict=True))
    times = Counter(key for key, _ in found)
    acknowledged = {
        (actor, epoch, number): checksum
        for (actor, epoch), numbers in ledgers.items()
        for number, checksum in numbers.items()
    }
    evicted = int(records["index"].max(initial=0)) - len(records)
    absent = sum(key not in times for key in acknowledged)
    return Audit(
        lives=len(ledgers),
        acknowledged=len(acknowledged),
        kept=len(records),
        evicted=evicted,
        lost=max(absent - evicted, 0),
        doubled=sum(count - 1 for count in times.values()),
        changed=sum(acknowledged.get(key, checksum) != checksum for key, checksum in found),
    )


def audit_folders(folder: Path, ledgers: Path) -> Audit:
    """Returns what became of the sequences of the actors that kept `ledgers`.

    Raises:
        BadInputError: a folder cannot be read, or a running service has it open.
    """
    acknowledged = read_ledgers(ledgers)
    journal = Journal(folder)
    try:
        kept = journal.open()
    finally:
        journal.close()
    if kept is None:
        raise BadInputError(f"{folder}: has no sequences, expected the folder of a replay service")
    return audit(acknowledged, kept)


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the audit as JSON."""
    parser = OneLineParser(prog="gfm_replay.audit", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument(
        "--folder", type=Path, required=True, metavar="DIR", help="the replay service's"
    )
    parser.add_argument(
        "--ledgers", type=Path, required=True, metavar="DIR", help="the actors' `ledger`"
    )
    asked = parser.parse_args(argv)

    def run() -> int:
        found = audit_folders(asked.folder, asked.ledgers)
        sys.stdout.write(json.dumps(asdict(found)) + "\n")
        return 0 if found.is_sound else 1

    return exit_status(run)


if __name__ == "__main__":
    sys.exit(main())
