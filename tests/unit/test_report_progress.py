"""The progress of a long run, on a terminal and in a log file; time moves only when told to."""

import io

import pytest
from rich.console import Console

from gfm.core import ConfigError, ManualClock, UnknownNameError
from gfm.experiments.progress import Phase, PhaseState, RunProgress, clock_face

PHASES = (
    Phase(name="record", expected_s=60.0),
    Phase(name="diagnose", expected_s=30.0),
    Phase(name="fit", expected_s=240.0),
)


class Shown:
    """A run whose clock and screen are in the test's hands."""

    def __init__(self, terminal=False, width=80, environ=None):
        self.clock = ManualClock()
        self.file = io.StringIO()
        self.console = Console(
            file=self.file, force_terminal=terminal, width=width, _environ=environ or {}
        )
        self.progress = RunProgress(PHASES, console=self.console, clock=self.clock)

    @property
    def lines(self):
        return self.file.getvalue().splitlines()

    def drawn(self):
        with self.console.capture() as capture:
            self.console.print(self.progress)
        return capture.get()


def test_the_time_left_is_the_sum_of_the_estimates_before_the_run_begins():
    assert Shown().progress.left_s == pytest.approx(330.0)


def test_the_time_left_shrinks_with_the_clock():
    shown = Shown()
    with shown.progress, shown.progress.phase("record"):
        shown.clock.advance_s(20.0)
        assert shown.progress.states[0].left_s(20.0) == pytest.approx(40.0)
        assert shown.progress.left_s == pytest.approx(310.0)


def test_the_share_done_corrects_the_estimate():
    shown = Shown()
    with shown.progress, shown.progress.phase("record"):
        shown.clock.advance_s(20.0)
        shown.progress.say("trajectory 1 of 10", share=0.2)
        assert shown.progress.states[0].left_s(20.0) == pytest.approx(80.0)


def test_a_small_share_does_not_throw_the_estimate_over():
    shown = Shown()
    with shown.progress, shown.progress.phase("record"):
        shown.clock.advance_s(20.0)
        shown.progress.say("starting", share=0.01)
        assert shown.progress.states[0].left_s(20.0) == pytest.approx(40.0)


def test_a_share_outside_0_to_1_is_clipped():
    shown = Shown()
    with shown.progress, shown.progress.phase("record"):
        shown.progress.say("more than all", share=1.7)
        assert shown.progress.states[0].share == 1.0


def test_a_phase_that_overruns_its_estimate_never_looks_finished():
    shown = Shown()
    with shown.progress, shown.progress.phase("record"):
        shown.clock.advance_s(500.0)
        state = shown.progress.states[0]
        assert state.left_s(500.0) == 0.0
        assert state.shown_share(500.0) == pytest.approx(0.99)
        assert "soon" in shown.drawn()


def test_phases_that_are_passed_over_count_nothing():
    shown = Shown()
    with shown.progress, shown.progress.phase("fit"):
        assert shown.progress.left_s == pytest.approx(240.0)


def test_nothing_is_left_after_the_last_phase():
    shown = Shown()
    with shown.progress:
        for phase in PHASES:
            with shown.progress.phase(phase.name):
                shown.clock.advance_s(7.0)
        assert shown.progress.left_s == 0.0
    assert shown.progress.durations_s() == pytest.approx({"record": 7, "diagnose": 7, "fit": 7})


def test_a_better_estimate_replaces_the_old_one():
    shown = Shown()
    shown.progress.expect("fit", 100.0)
    assert shown.progress.left_s == pytest.approx(190.0)


def test_a_file_gets_one_plain_line_per_event():
    shown = Shown()
    with shown.progress, shown.progress.phase("record"):
        shown.clock.advance_s(61.0)
        shown.progress.say("trajectory 3 of 4", share=0.75)
    assert shown.lines == [
        "[  0:00] 1/3 record (left: 1:00, whole run 5:30)",
        "[  1:01] record: trajectory 3 of 4 (left: 0:20, whole run 4:50)",
        "[  1:01] record: done in 1:01",
        "[  1:01] done after 1:01",
    ]


def test_a_file_is_not_flooded():
    shown = Shown()
    with shown.progress, shown.progress.phase("record"):
        for _ in range(600):
            shown.clock.advance_s(0.1)
            shown.progress.say("driving")
    assert 10 <= sum("driving" in line for line in shown.lines) <= 13


def test_a_long_line_in_a_file_is_not_broken():
    shown = Shown(width=20)
    with shown.progress, shown.progress.phase("record"):
        shown.clock.advance_s(10.0)
        shown.progress.say("a long story " * 10)
    assert sum("a long story" in line for line in shown.lines) == 1


def test_square_brackets_in_what_is_said_are_no_markup():
    shown = Shown()
    with shown.progress, shown.progress.phase("record"):
        shown.clock.advance_s(10.0)
        shown.progress.say("joint [red]j0[/red]")
    assert any("joint [red]j0[/red]" in line for line in shown.lines)


def test_a_dumb_terminal_gets_lines_too():
    shown = Shown(terminal=True, environ={"TERM": "dumb"})
    with shown.progress, shown.progress.phase("record"):
        pass
    assert any("1/3 record" in line for line in shown.lines)


def test_a_terminal_gets_a_table_that_stays_after_the_end():
    shown = Shown(terminal=True)
    with shown.progress, shown.progress.phase("record"):
        shown.clock.advance_s(12.0)
        shown.progress.say("trajectory 1 of 4")
    assert "record" in shown.file.getvalue()
    assert "0:12 so far, about 4:30 left" in shown.file.getvalue()
    assert "1/3" not in shown.file.getvalue()


@pytest.mark.parametrize("width", [80, 60])
def test_the_table_fits_the_terminal(width):
    shown = Shown(width=width)
    with shown.progress, shown.progress.phase("record"):
        shown.progress.say("driving the waypoint trajectory number 12 in joint velocity mode")
        assert max(map(len, shown.drawn().splitlines())) <= width


def test_an_error_in_a_phase_leaves_it_unfinished():
    shown = Shown()
    with pytest.raises(ConfigError), shown.progress, shown.progress.phase("record"):
        raise ConfigError("no robot")
    assert shown.progress.durations_s() == {}
    assert not any("done" in line for line in shown.lines)


def test_words_outside_any_phase_are_dropped():
    shown = Shown()
    shown.progress.say("hello")
    assert shown.lines == []


def test_an_unknown_phase_is_refused_with_those_that_exist():
    shown = Shown()
    with (
        pytest.raises(UnknownNameError, match=r"unknown phase 'sleep'.*diagnose, fit, record"),
        shown.progress.phase("sleep"),
    ):
        pass


def test_a_negative_estimate_is_refused():
    with pytest.raises(ConfigError, match=r"'record' is expected to take -1\.0 s"):
        Phase(name="record", expected_s=-1.0)


def test_a_phase_that_has_not_begun_has_taken_no_time():
    assert PhaseState(phase=PHASES[0]).elapsed_s(99.0) == 0.0


@pytest.mark.parametrize(
    ("seconds", "face"), [(0.0, "0:00"), (59.6, "1:00"), (65.0, "1:05"), (3725.0, "1:02:05")]
)
def test_a_clock_face_has_hours_only_where_needed(seconds, face):
    assert clock_face(seconds) == face
