"""Starts, watches and stops the services as processes of this machine."""

from gfm.launch.spec import (
    LOCKSTEP,
    ProcessSpec,
    SystemSpec,
    actor_processes,
    free_endpoint,
    learner_process,
    replay_process,
    robot_processes,
)
from gfm.launch.supervisor import Supervisor, watching
from gfm.launch.survey import statuses, summary

__all__ = [
    "LOCKSTEP",
    "ProcessSpec",
    "Supervisor",
    "SystemSpec",
    "actor_processes",
    "free_endpoint",
    "learner_process",
    "replay_process",
    "robot_processes",
    "statuses",
    "summary",
    "watching",
]
