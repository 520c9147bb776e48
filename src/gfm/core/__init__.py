"""The values everyone speaks. NumPy only; no file, socket, clock or random state of its own."""

from gfm.core.clock import Clock, ManualClock, MonotonicClock
from gfm.core.errors import (
    BadInputError,
    ConfigError,
    GfmError,
    LostError,
    ProcessDiedError,
    RecordingError,
    RefusedError,
    ShapeError,
    StaleWeightsError,
    UnknownNameError,
    UnreachableError,
    WireError,
)
from gfm.core.plausible import ACTION_LIMIT, LOG_PROB_LIMIT, PRIORITY_LIMIT, implausible
from gfm.core.robot import Command, CommandKind, Observation, Reason
from gfm.core.sequence import (
    SEQUENCE_ARRAYS,
    SEQUENCE_LENGTH,
    Batch,
    EnvironmentSpec,
    Sequence,
    arrays_checksum,
)
from gfm.core.status import Status
from gfm.core.trajectory import ObjectTrack, Trajectory
from gfm.core.weights import Weights

__all__ = [
    "ACTION_LIMIT",
    "LOG_PROB_LIMIT",
    "PRIORITY_LIMIT",
    "SEQUENCE_ARRAYS",
    "SEQUENCE_LENGTH",
    "BadInputError",
    "Batch",
    "Clock",
    "Command",
    "CommandKind",
    "ConfigError",
    "EnvironmentSpec",
    "GfmError",
    "LostError",
    "ManualClock",
    "MonotonicClock",
    "ObjectTrack",
    "Observation",
    "ProcessDiedError",
    "Reason",
    "RecordingError",
    "RefusedError",
    "Sequence",
    "ShapeError",
    "StaleWeightsError",
    "Status",
    "Trajectory",
    "UnknownNameError",
    "UnreachableError",
    "Weights",
    "WireError",
    "arrays_checksum",
    "implausible",
]
