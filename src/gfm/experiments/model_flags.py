"""Flags about models and recordings that several commands share."""

from __future__ import annotations

import argparse

#: In the place of a model's file, for messages and help.
MODEL = "MODEL"
#: What a model may be, for help.
GIVEN = "MJCF or URDF of the robot, or robot_descriptions:NAME"


def add_actuators(parser: argparse._ActionsContainer) -> None:
    """Adds --actuators."""
    parser.add_argument(
        "--actuators",
        metavar="RULE",
        help="what joints without an actuator get: position:kp=50,kv=1, velocity:kv=5 or torque",
    )


def add_guess(parser: argparse._ActionsContainer, yes: str) -> None:
    """Adds --yes, --use and --unit: files of other tools are read by a mapping that is guessed.

    Args:
        parser: Of the command.
        yes: What --yes does, for help.
    """
    parser.add_argument("--yes", action="store_true", help=yes)
    parser.add_argument(
        "--use",
        action="append",
        default=[],
        metavar="NAME",
        help="topic or column to take where several fit: its name, the beginning of a column's "
        "name, or a word in either",
    )
    parser.add_argument(
        "--unit",
        choices=("rad", "degrees", "normalised"),
        help="unit of positions, where their size does not tell it",
    )


def add_topics(parser: argparse._ActionsContainer) -> None:
    """Adds --joint-states and --command: where a recording has what."""
    parser.add_argument(
        "--joint-states",
        default="/joint_states",
        metavar="TOPIC",
        help="measurements (default: %(default)s)",
    )
    parser.add_argument(
        "--command",
        default="/joint_command",
        metavar="TOPIC",
        help="commands (default: %(default)s)",
    )
