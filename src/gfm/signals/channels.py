"""What stamps and single signals say of a recording.

Stamps: jitter, gaps, a clock that jumps, measurements told twice. Signals: channels that stand
still, rounding, odd units.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.core.noise import noise_std
from gfm.core.rounding import resolution
from gfm.signals.finding import Finding, findings
from gfm.signals.smoothing import correlation, slope, smooth_states

#: Standard deviation of the period, as a share of it, from which accelerations suffer.
JITTER = 0.10
#: A gap is so many typical periods long: four messages in a row were lost.
GAP_PERIODS = 5.0
#: So many measurements around a gap tell whether the motion went on without it.
ACROSS = 12
#: Share of the measurements under motion that repeat the one before.
REPEATED = 0.05
#: Steps of a motion are so many measurements apart at most, and so many must be seen.
MOST_HELD, LEAST_STEPS = 10, 30
#: Sequential reading takes a millisecond or more for each joint: shorter cycles leave no room.
LEAST_CYCLE_S = 0.005
#: How closely two signals must follow each other for their ratio to mean a unit.
FOLLOWS = 0.8


def jitter(recording: Trajectory) -> list[Finding]:
    """Finds stamps that scatter; gaps are another matter."""
    period_s = recording.period_s
    periods = np.diff(recording.time_s)
    share = float(np.std(periods[periods < GAP_PERIODS * period_s])) / period_s
    if share < JITTER:
        return []
    advice = "velocities scatter as much: stamp at the measurement, not at the arrival"
    return findings(recording, "stamps jitter by", 100.0 * share, "% of the period", advice)


def gaps(recording: Trajectory) -> list[Finding]:
    """Finds gaps, and tells lost messages from a clock that jumped.

    Where a joint moves, it covers a gap's time at its speed if messages were lost, and only the
    way of one period if the clock jumped.
    """
    time_s, period_s = recording.time_s, recording.period_s
    places = np.flatnonzero(np.diff(time_s) > GAP_PERIODS * period_s)
    jumped = [i for i in places if _jumped(recording, int(i), period_s)]
    lost = np.setdiff1d(places, jumped)
    lengths = np.diff(time_s)
    found = list[Finding]()
    if len(lost):
        advice = "what happens inside is not seen"
        found += findings(recording, "longest gap", lengths[lost].max(), "s", advice)
    if jumped:
        advice = "the motion goes on as if no time had passed: a stamping clock was set"
        found += findings(recording, "clock jumps by", lengths[jumped].max(), "s", advice)
    return found


def _jumped(recording: Trajectory, i: int, period_s: float) -> bool:
    """Returns whether the motion across gap `i` is that of one period.

    That is: where joints move, a cubic through the measurements around the gap, taken as evenly
    spaced, fits as well as one does elsewhere.
    """
    q, t = recording.position, recording.time_s
    start = i + 1 - ACROSS // 2
    if start < 0 or start + ACROSS > len(q):
        return False
    before, after = slice(start, i + 1), slice(i + 1, start + ACROSS)
    speed = np.abs(slope(q[before], t[before])) + np.abs(slope(q[after], t[after]))
    noise = noise_std(t, q)
    fast = 0.5 * speed * (t[i + 1] - t[i] - period_s) > 20.0 * noise
    even = np.lib.stride_tricks.sliding_window_view(q, ACROSS, axis=0)
    elsewhere = np.percentile(_cubic_misfit(even[:: ACROSS // 2]), 75.0, axis=0)
    across = _cubic_misfit(even[start][None])[0]
    return bool(fast.any() and (across < 3.0 * (elsewhere + noise))[fast].all())


def _cubic_misfit(windows: Array) -> Array:
    """Returns what cubics leave of even parts (W, J, ACROSS): root mean square, (W, J)."""
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, ACROSS), 4))
    rest = windows - windows @ basis @ basis.T
    return np.asarray(np.sqrt(np.mean(rest**2, axis=-1)))


def repeated(recording: Trajectory) -> list[Finding]:
    """Finds measurements that repeat the one before in the middle of a motion.

    That is between two steps, each larger than rounding makes them, that are close in time; and
    regularly, or it would be a joint that sticks and slips.
    """
    steps = np.abs(np.diff(recording.position, axis=0))
    large = np.flatnonzero((steps > 3.0 * resolution(recording.position) + 1e-9).any(axis=1))
    idle = np.concatenate([[0], np.cumsum((steps > 0.0).any(axis=1))])
    between = np.diff(large)
    held = (between <= MOST_HELD) & (idle[large[1:]] - idle[large[:-1] + 1] == 0)
    if held.sum() < LEAST_STEPS or np.percentile(between[held], 95.0) > 2.0 * between[held].mean():
        return []
    share = 1.0 - held.sum() / between[held].sum()
    if share < REPEATED:
        return []
    advice = "the sensor is read less often than it is logged: up to a period of delay more"
    return findings(recording, "measurements told twice", 100.0 * share, "%", advice)


def one_stamp_a_cycle(recording: Trajectory) -> list[Finding]:
    """Finds stamps that measurements share with commands, where reading joints takes time."""
    period_s, joints = recording.period_s, len(recording.joint_names)
    shared = float(np.isin(recording.stamp_ns, recording.command_stamp_ns).mean())
    if shared < 0.95 or joints < 3 or period_s < LEAST_CYCLE_S:
        return []
    advice = (
        "one stamp for commands and all joints: if they are read one after the other, this much "
        "may look like a delay that falls from joint to joint (read_offset_s of an import mapping)"
    )
    what = "one stamp for a cycle of"
    return findings(recording, what, 1e3 * period_s, "ms", advice, doubtful=False)


def still(recording: Trajectory) -> list[Finding]:
    """Finds joints whose position or command never changes."""
    position, command = (
        {j: values[0, j] for j in np.flatnonzero(np.ptp(values, axis=0) == 0.0).tolist()}
        for values in (recording.position, recording.command)
    )
    silent, idle = "says nothing of its dynamics", "not excited on purpose"
    return [
        *findings(recording, "position never changes", position, "", silent),
        *findings(recording, "command never changes", command, "", idle, doubtful=False),
    ]


def rounded(recording: Trajectory) -> list[Finding]:
    """Finds the step to which positions are rounded, where it is no less than their noise."""
    steps = resolution(recording.position)
    noise = noise_std(recording.time_s, recording.position)
    seen = np.flatnonzero((steps > 0.0) & (steps > noise)).tolist()
    coarse = {j: 1e3 * steps[j] for j in seen}
    advice = "no error below a third of it can be seen"
    return findings(recording, "encoder step", coarse, "mrad", advice, doubtful=False)


def odd_velocities(recording: Trajectory) -> list[Finding]:
    """Finds velocities that follow the position's slope at another scale."""
    odd = {j: r for j, r in velocity_ratios(recording).items() if not 0.5 < r < 2.0}
    advice = "1 expected: another unit (rpm is 9.55)? velocities are not used"
    return findings(recording, "velocity over the position's slope", odd, "", advice)


def velocity_ratios(recording: Trajectory) -> dict[int, float]:
    """Returns velocity over d position / dt, by a joint's number, where they follow each other."""
    if recording.velocity is None:
        return {}
    _, speed, _ = smooth_states(recording.time_s, recording.position)
    pairs = enumerate(zip(recording.velocity.T, speed.T, strict=True))
    return {
        j: float(slope(told, seen))
        for j, (told, seen) in pairs
        if abs(correlation(told, seen)) > FOLLOWS
    }
