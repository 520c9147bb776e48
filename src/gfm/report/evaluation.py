"""The test of a control policy for people and programs: rate, table, reasons, paths.

Shape letters: M attempts, S moments.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from rich.console import Console
from rich.table import Table
from rich.text import Text
from scipy.stats import binomtest

from gfm.envs.evaluation import Attempts
from gfm.envs.matching_task import MatchingTask
from gfm.envs.outcomes import Outcome
from gfm.report.figures import GREEN, INK, ORANGE, Picture, styled
from gfm.report.page import render_page

SCHEMA = "gfm.evaluation/1"
REASONS = {
    Outcome.REACHED: "goal reached and held",
    Outcome.OUT_OF_TIME: "out of time",
    Outcome.TOOL_LEFT_WORKSPACE: "the tool left its workspace",
    Outcome.OBJECT_LEFT_BASKET: "the object left the basket",
    Outcome.DIVERGED: "the simulation diverged",
    Outcome.PROTECTIVE_STOP: "the bridge stopped the arm",
}
#: Where on the page lies the object's path, m from the basket's centre.
_SHOWN_M = 0.2


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """A test and where it comes from.

    Attributes:
        task: What was tried.
        attempts: What came of it.
        trials: Attempts per goal.
        provenance: Files, versions, seed and command.
        where: What the policy acted on.
        films: Names of films beside the report.
        notes: What a reader should know.
    """

    task: MatchingTask
    attempts: Attempts
    trials: int
    provenance: Mapping[str, object]
    where: str = "in simulation"
    films: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def reached(self) -> int:
        """Attempts that succeeded."""
        return int(self.attempts.reached.sum())

    @property
    def of(self) -> int:
        """All attempts."""
        return len(self.attempts.outcome)

    @property
    def interval(self) -> tuple[float, float]:
        """Of the success rate, 95 % (Wilson 1927)."""
        found = binomtest(self.reached, self.of).proportion_ci(0.95, method="wilson")
        return float(found.low), float(found.high)

    @property
    def sentence(self) -> str:
        """The result in one line."""
        low, high = self.interval
        return (
            f"{self.task.name}: {self.reached} of {self.of} attempts succeeded, "
            f"{self.reached / self.of:.0%} (95 % interval {low:.0%} to {high:.0%}), {self.where}"
        )

    @property
    def failures(self) -> dict[str, int]:
        """How often each reason ended an attempt without success, most frequent first."""
        reasons = [REASONS[Outcome(one)] for one in self.attempts.outcome.tolist()]
        counted = Counter(reason for reason in reasons if reason != REASONS[Outcome.REACHED])
        return dict(counted.most_common())

    def lines(self) -> list[GoalLine]:
        """Returns one line per goal."""
        return [_goal_line(self, number) for number in range(len(self.attempts.goals))]


@dataclass(frozen=True, kw_only=True)
class GoalLine:
    """The attempts at one goal.

    Attributes:
        number: From 1.
        x_m: From the basket's centre.
        y_m: From the basket's centre.
        yaw_deg: None where it does not matter.
        reached: Successes.
        of: Attempts.
        time_s: Median over the successes; None without one.
        left_m: Median distance at the end.
        left_deg: Median difference in yaw at the end; None where it does not matter.
    """

    number: int
    x_m: float
    y_m: float
    yaw_deg: float | None
    reached: int
    of: int
    time_s: float | None
    left_m: float
    left_deg: float | None


def _goal_line(evaluation: Evaluation, number: int) -> GoalLine:
    attempts, task = evaluation.attempts, evaluation.task
    mine = attempts.goal == number
    reached = mine & attempts.reached
    x, y = attempts.goals[number, :2] - task.rest_position[:2]
    turns = task.tolerance_rad is not None
    return GoalLine(
        number=number + 1,
        x_m=float(x),
        y_m=float(y),
        yaw_deg=math.degrees(attempts.goals[number, 2]) if turns else None,
        reached=int(reached.sum()),
        of=int(mine.sum()),
        time_s=float(np.median(attempts.time_s[reached])) if reached.any() else None,
        left_m=float(np.median(attempts.place[mine])),
        left_deg=math.degrees(float(np.median(attempts.turn[mine]))) if turns else None,
    )


def evaluation_json(evaluation: Evaluation) -> dict[str, object]:
    """Returns the document "gfm.evaluation/1"."""
    low, high = evaluation.interval
    attempts = evaluation.attempts
    return {
        "schema": SCHEMA,
        "task": evaluation.task.name,
        "where": evaluation.where,
        "success": {
            "reached": evaluation.reached,
            "of": evaluation.of,
            "rate": evaluation.reached / evaluation.of,
            "ci95": [low, high],
        },
        "failures": evaluation.failures,
        "goals": [vars(line) for line in evaluation.lines()],
        "attempts": [
            {
                "goal": int(attempts.goal[i]) + 1,
                "outcome": Outcome(int(attempts.outcome[i])).name.lower(),
                "time_s": float(attempts.time_s[i]),
                "left_m": float(attempts.place[i]),
                "left_rad": float(attempts.turn[i]),
            }
            for i in range(evaluation.of)
        ],
        "films": list(evaluation.films),
        "notes": list(evaluation.notes),
        "provenance": dict(evaluation.provenance),
    }


def evaluation_texts(evaluation: Evaluation) -> dict[str, str]:
    """Returns the report's files by name."""
    document = json.dumps(evaluation_json(evaluation), indent=2, allow_nan=False)
    return {"report.json": document + "\n", "report.html": evaluation_html(evaluation)}


def evaluation_html(evaluation: Evaluation) -> str:
    """Returns the test as one HTML page that needs nothing beside it but its films."""
    return render_page(
        "evaluation.html.j2",
        evaluation=evaluation,
        lines=evaluation.lines(),
        turns=evaluation.task.tolerance_rad is not None,
        paths=paths_picture(evaluation),
    )


def print_evaluation(console: Console, evaluation: Evaluation) -> None:
    """Prints the sentence, a line per goal and why attempts failed."""
    console.print(Text(evaluation.sentence, style="bold"))
    table = Table("goal", "x mm", "y mm", "yaw", "reached", "median s", "left mm", "left yaw")
    for line in evaluation.lines():
        table.add_row(
            str(line.number),
            f"{1e3 * line.x_m:.0f}",
            f"{1e3 * line.y_m:.0f}",
            _shown(line.yaw_deg, "°"),
            f"{line.reached} of {line.of}",
            _shown(line.time_s, "", 1),
            f"{1e3 * line.left_m:.0f}",
            _shown(line.left_deg, "°"),
        )
    console.print(table)
    for reason, count in evaluation.failures.items():
        console.print(Text(f"{count} x {reason}"))
    for note in evaluation.notes:
        console.print(Text(note))


def _shown(value: float | None, unit: str, digits: int = 0) -> str:
    return "–" if value is None else f"{value:.{digits}f}{unit}"


def paths_picture(evaluation: Evaluation) -> Picture:
    """Returns where the object went in every attempt, over the goals and their tolerance."""
    attempts, centre = evaluation.attempts, evaluation.task.rest_position[:2]
    figure = go.Figure()
    for x, y in attempts.goals[:, :2] - centre:
        radius = evaluation.task.tolerance_m
        figure.add_shape(
            type="circle",
            x0=x - radius,
            x1=x + radius,
            y0=y - radius,
            y1=y + radius,
            line={"color": INK, "width": 1, "dash": "dot"},
        )
    for label, colour, wanted in (("reached", GREEN, True), ("missed", ORANGE, False)):
        x, y = _joined(evaluation, wanted=wanted)
        line = {"color": colour, "width": 1.5}
        figure.add_trace(go.Scatter(x=x, y=y, mode="lines", name=label, line=line))
    styled(figure, height=620)
    span = [-_SHOWN_M, _SHOWN_M]
    figure.update_xaxes(title_text="x from the basket's centre (m)", range=span)
    figure.update_yaxes(title_text="y (m)", range=span, scaleanchor="x")
    caption = (
        "Seen from above, the robot on the left. Every line is the way of the object in one "
        "attempt, from the centre until it was decided; dotted circles are the goals with their "
        "tolerance. Look for lines that end outside, and for goals that none reaches."
    )
    return Picture(title="Ways of the object", caption=caption, figure=figure)


def _joined(evaluation: Evaluation, *, wanted: bool) -> tuple[list[float], list[float]]:
    """Returns all paths of one kind as one line with gaps; every second moment is enough."""
    attempts = evaluation.attempts
    relative = attempts.path[:, ::2] - evaluation.task.rest_position[:2]
    x: list[float] = []
    y: list[float] = []
    for path in relative[attempts.reached == wanted]:
        known = path[np.isfinite(path[:, 0])].round(4)
        x += [*known[:, 0].tolist(), math.nan]
        y += [*known[:, 1].tolist(), math.nan]
    return x, y
