"""A process that tracks a brick that lies still, by corners projected as three cameras see them.

python tests/projected_tracker.py ENDPOINT RUN
"""

from __future__ import annotations

import sys

import numpy as np

from gfm.core import MonotonicClock
from gfm.experiments.track_send import PoseSender
from gfm.launch.address import RunAddress
from gfm.sim.cell import object_boxes
from gfm.tracking.cell_cameras import cell_cameras
from gfm.tracking.layout import cell_layout
from gfm.tracking.projected import Faults, detection
from gfm.tracking.rigid import pose_of
from gfm.tracking.tracker import Look, Tracker, TrackerState
from gfm_wire import Role

#: Where the brick lies, m and quaternion w x y z.
LIES = (0.62, 0.03, 0.08, 1.0, 0.0, 0.0, 0.0)
_PERIOD_NS = 33_333_333
_FAULTS = Faults(noise_px=0.3, bad_tags=0.1, lost=0.1)


def main(endpoint: str, run: str, certs: str) -> None:
    """Tracks until it is killed."""
    clock, rng = MonotonicClock(), np.random.default_rng(0)
    cameras, layout = cell_cameras(), cell_layout("brick")
    boxes, pose = object_boxes("brick"), pose_of(np.array(LIES))
    tracker, state = Tracker(cameras, layout), TrackerState()
    address = RunAddress(run=run, endpoint=endpoint, certs=certs)
    with address.open(Role.TRACKER, name="projected") as transport:
        sender = PoseSender(transport, clock)
        while True:
            began_ns = clock.now_ns()
            seen = {c.name: detection(c, layout, boxes, pose, _FAULTS, rng) for c in cameras}
            looks = [
                Look(camera=name, time_s=1e-9 * began_ns, seen=found)
                for name, found in seen.items()
                if found is not None
            ]
            now_s = 1e-9 * clock.now_ns()
            told, state = tracker.step(now_s, looks, state)
            sender.tell(told, now_s)
            clock.sleep_until_ns(began_ns + _PERIOD_NS)


if __name__ == "__main__":
    main(*sys.argv[1:])
