"""Lets a replay service meet a full disk, and room again.

    mount -t tmpfs -o size=8m tmpfs /mnt/small
    python benchmarks/full_disk.py --folder /mnt/small

The folder is on a small filesystem, which is filled up first. An actor's outbox sends to the
service, a process of its own, over zenoh; then the filling is taken away. What was acknowledged is
compared with what the folder holds in the end.
"""

from __future__ import annotations

import argparse
import shutil
import time
from pathlib import Path

from replay_kills import Actor, start, status, stored, until_answered

from gfm.launch import free_endpoint

_FULL_S, _ROOM_S = 3.0, 2.0
_BLOCK = 2**16


def fill(path: Path) -> None:
    """Writes a file until the disk takes no more."""
    with path.open("wb", buffering=0) as file:
        try:
            while file.write(bytes(_BLOCK)) == _BLOCK:
                pass
        except OSError:
            return


def main() -> None:
    """Runs it and prints what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--folder", type=Path, required=True, help="of a small filesystem")
    folder = parser.parse_args().folder
    ballast, endpoint = folder / "ballast", free_endpoint()
    fill(ballast)
    print(f"free: {shutil.disk_usage(folder).free} bytes")
    actor = Actor(endpoint)
    process = start(endpoint, folder / "replay", capacity_mib=4)
    try:
        while actor.outbox.note.startswith("waiting") or not actor.outbox.note:
            actor.step(send=True)
        pump(actor, _FULL_S)
        told = status(actor)
        print(f"full: {actor.outbox.acked} acknowledged, {actor.outbox.refused} refused, asked to")
        print(f"  wait {told.counters['no_room']} times: {actor.outbox.note}")
        ballast.unlink()
        until_answered(actor)
        pump(actor, _ROOM_S)
        fill(ballast)
        pump(actor, _ROOM_S)
        while len(actor.outbox):
            actor.step(send=False)
        told = status(actor)
    finally:
        process.terminate()
        process.wait()
    kept = {number for number, as_sent in stored(folder / "replay") if as_sent}
    fitting = int(told.gauges["replay_stored_sequences"])
    wanted = sorted(actor.acknowledged())[-fitting:]
    print(f"room, and full again: {actor.outbox.acked} of {actor.outbox.sent} acknowledged,")
    print(
        f"  {len(kept)} in the folder, of the newest that fit {len(set(wanted) - kept)} are missing"
    )
    actor.transport.close()


def pump(actor: Actor, seconds: float) -> None:
    """Lets the actor go on for so long."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        actor.step(send=True)


if __name__ == "__main__":
    main()
