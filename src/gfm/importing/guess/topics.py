"""Which topics of a ROS bag hold measurements and commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gfm.core import RecordingError
from gfm.importing.guess.names import TOLD, has_word, joint_of, words
from gfm.importing.guess.robot import Robot
from gfm.importing.guess.signals import Signal, signals_of
from gfm.importing.ros_bag import Bag, read_bag
from gfm.importing.ros_messages import JOINT_STATE, MULTI_ARRAY, ROW_OF, TRAJECTORY
from gfm.importing.tables import Table


@dataclass(frozen=True, kw_only=True)
class Topic:
    """One topic that may be used.

    Attributes:
        name: The topic.
        kind: Its type.
        table: Its messages.
        signals: Those of the model's joints.
    """

    name: str
    kind: str
    table: Table
    signals: Sequence[Signal]

    def joints(self, *, told: bool) -> set[str]:
        """Returns whose measurements, or commands, it has."""
        return {one.joint for one in self.signals if one.role.told is told}


def bag_topics(path: Path, robot: Robot, use: Sequence[str]) -> tuple[Topic, Topic]:
    """Returns the topics of measurements and of commands.

    Args:
        path: The bag.
        robot: The model's joints.
        use: Topics to take where several fit, or words in their names.

    Raises:
        RecordingError: none fits, or several do; with all topics and their types.
    """
    bag = read_bag(path)
    topics = [_topic(bag, name, robot) for name in sorted(bag.rows)]
    states = _best(bag, "joint states", topics, use, told=False)
    return states, _best(bag, "commands", topics, use, told=True)


def _topic(bag: Bag, name: str, robot: Robot) -> Topic:
    kind, table = bag.types[name], bag.table(name, _wanted(bag, name, robot))
    told = kind in (MULTI_ARRAY, TRAJECTORY) or (kind == JOINT_STATE and _says_told(name))
    signals = signals_of(table, robot, told=told)
    return Topic(name=name, kind=kind, table=table, signals=signals)


def _says_told(topic: str) -> bool:
    """Returns whether a topic's name says so; /ctrl/joint_states are measured all the same."""
    measured = {"state", "states"} & set(words(topic.rpartition("/")[2]))
    return bool(TOLD & set(words(topic))) and not measured


def _wanted(bag: Bag, topic: str, robot: Robot) -> set[str]:
    """Returns the columns that name a joint of the model."""
    there = {column for row in bag.rows[topic] for column in row}
    return {column for column in there if joint_of(words(column), robot.joints)[0]}


def _best(
    bag: Bag,
    what: str,
    topics: Sequence[Topic],
    use: Sequence[str],
    *,
    told: bool,
) -> Topic:
    fitting = [topic for topic in topics if topic.joints(told=told)]
    most = max((len(topic.joints(told=told)) for topic in fitting), default=0)
    best = [topic for topic in fitting if len(topic.joints(told=told)) == most]
    asked = [topic for topic in best if topic.name in use]
    best = asked or [topic for topic in best if has_word(topic.name, use)] or best
    # A controller's state tells both: a topic for one of them alone comes first.
    best = [topic for topic in best if not topic.joints(told=not told)] or best
    if len(best) == 1:
        return best[0]
    there = ", ".join(f"{name} ({kind})" for name, kind in sorted(bag.types.items())) or "none"
    if best:
        several = f"{what} of the model's joints on {', '.join(topic.name for topic in best)}"
        raise RecordingError(str(bag.path), several, "one topic (--use TOPIC says which)")
    for topic, problem in bag.problems.items():
        if bag.types[topic] in ROW_OF:
            raise problem
    raise RecordingError(
        str(bag.path),
        f"no topic with {what} of the model's joints",
        f"one of {', '.join(ROW_OF)}; topics in the bag: {there}",
    )
