"""Starts, watches and stops the services as processes of this machine."""

from gfm.launch.address import RunAddress
from gfm.launch.keeper import Keeper
from gfm.launch.own_certs import own_system
from gfm.launch.spec import (
    LOCKSTEP,
    ProcessSpec,
    SystemSpec,
    actor_processes,
    free_endpoint,
    learner_process,
    replay_process,
    robot_processes,
    router_process,
    sequence_length_of,
)
from gfm.launch.supervision import SupervisionConfig
from gfm.launch.supervisor import Supervisor, watching
from gfm.launch.survey import statuses, summary

__all__ = [
    "LOCKSTEP",
    "Keeper",
    "ProcessSpec",
    "RunAddress",
    "SupervisionConfig",
    "Supervisor",
    "SystemSpec",
    "actor_processes",
    "free_endpoint",
    "learner_process",
    "own_system",
    "replay_process",
    "robot_processes",
    "router_process",
    "sequence_length_of",
    "statuses",
    "summary",
    "watching",
]
