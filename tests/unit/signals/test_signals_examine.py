"""All checks together: what a diagnosis is told of its recordings."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.findings import all_findings
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.signals.examine import doubts, findings_of

MODEL = """
<mujoco>
  <worldbody>
    <body>
      <joint name="a" axis="0 1 0" damping="0.2" armature="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/>
      {wrist}
    </body>
  </worldbody>
  <actuator><position name="a" joint="a" kp="20" kv="1"/>{servo}</actuator>
</mujoco>
"""
WRIST = '<body pos="0 0 -0.3"><joint name="b"/><geom size="0.02"/></body>'
SERVO = '<position name="b" joint="b" kp="5" kv="0.1"/>'
T = 0.01 * np.arange(900)


@pytest.fixture
def waves(make):
    """Returns two recordings of sums of sines with noise."""

    def recording(name: str, seed: int):
        rng = np.random.default_rng(seed)
        wave = sum(0.2 * np.sin(w * T + rng.uniform(0.0, 6.0)) for w in (2.0, 5.0, 11.0))
        measured = np.roll(wave, 4) + 1e-4 * rng.standard_normal(len(T))
        return make(T, measured, command=wave, name=name)

    return recording("one", 0), recording("two", 1)


def findings(recordings, **parts: str):
    text = MODEL.format(**({"wrist": "", "servo": ""} | parts))
    specs = {CommandKind.POSITION: mujoco.MjSpec.from_string(text)}
    return all_findings(prepared(all_segments(specs, recordings)), recordings, [])


def test_nothing_is_doubtful_in_good_recordings(waves):
    found = findings(waves)
    assert doubts(found) == doubts(found, "one") == doubts(found, "two") == ()
    (late,) = (one for one in found if one.what == "answers position commands after")
    # Four rows late; a command that is held acts half a period later than its row, on average.
    assert late.value == pytest.approx(35.0, abs=1.0)


def test_a_joint_that_is_driven_but_never_recorded_is_doubtful(waves):
    (told,) = doubts(findings(waves, wrist=WRIST, servo=SERVO))
    assert told.startswith("b: driven in the model, never recorded")


def test_a_flaw_is_told_of_the_recording_that_has_it(waves, make, pendulum):
    gap = np.concatenate([np.arange(400), np.arange(450, 900)])
    flawed = make(T[gap], waves[0].position[gap, 0], command=waves[0].command[gap, 0], name="gap")
    (told,) = doubts(findings_of(flawed, pendulum()), "gap")
    assert told == "longest gap 0.51 s (what happens inside is not seen)"
