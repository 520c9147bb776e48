"""What `gfm import` may be told: which columns of a table are which signals of a recording."""

from __future__ import annotations

import tomllib
from pathlib import Path

import msgspec

from gfm.core import CommandKind, ConfigError
from gfm.importing.formats import TABLE_FORMATS

#: Joints are read within a cycle; more is another unit.
MOST_OFFSET_S = 0.1

#: What may be known of a joint.
SIGNALS = ("position", "velocity", "effort", "command")
FORMATS = (*TABLE_FORMATS, "lerobot", "rosbag")


class Column(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where a signal's numbers lie: value = scale * number + offset.

    Attributes:
        column: Header of the column, key of the JSON rows, or name of an array.
        index: Which element, where a cell is a bracketed list.
        scale: From the file's unit to rad, rad/s, N m or s; -1 turns an axis around.
        offset: In the target unit.
        wrap: For signed counters that were stored as unsigned ones: numbers from half of this
            value on have it subtracted (65536 for 16 bit).
    """

    column: str
    index: int | None = None
    scale: float = 1.0
    offset: float = 0.0
    wrap: float | None = None


class JointColumns(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The signals of one joint.

    Attributes:
        name: The joint's name in the recording and in the model.
        position: Measured, rad.
        command: Setpoint: rad, rad/s or N m, as `command_kind` says.
        velocity: Measured, rad/s; for all joints or for none.
        effort: Measured torque, N m; for all joints or for none.
        read_offset_s: How much later than its row's stamp this joint was read, s: robots that ask
            one joint after the other stamp them all alike. Negative for earlier.
    """

    name: str
    position: str | Column
    command: str | Column
    velocity: str | Column | None = None
    effort: str | Column | None = None
    read_offset_s: float = 0.0

    def __post_init__(self) -> None:
        if not abs(self.read_offset_s) <= MOST_OFFSET_S:
            raise ValueError(
                f"read_offset_s of {self.name} is {self.read_offset_s}, expected at most "
                f"{MOST_OFFSET_S} s, either way"
            )


class ObjectColumns(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The pose of a free object, in the table with the measurements: m, and a unit quaternion."""

    x: str | Column
    y: str | Column
    z: str | Column
    qw: str | Column
    qx: str | Column
    qy: str | Column
    qz: str | Column


class Files(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the files of one recording are told apart, where there are two.

    Attributes:
        states: Name of the file with the measurements without .gz, `*` for what names the
            recording.
        commands: Name of the file with the commands, likewise.
    """

    states: str
    commands: str


class Topics(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where in a ROS bag the signals lie; one topic may hold both.

    Attributes:
        states: Topic of the measurements.
        commands: Topic of the commands.
    """

    states: str
    commands: str


class ServoGain(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A setting of the servo that differs between recordings.

    Attributes:
        header: Field of the file's header that holds the gain.
        reference: The gain that the model stands for; recordings carry gain / reference.
    """

    header: str
    reference: float


class Released(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How rows tell that the servo was switched off.

    Such rows become recordings of their own with a servo gain of 0.

    Attributes:
        column: The column that tells.
        value: What it says while the servo is off (as text, case ignored).
    """

    column: str
    value: str


class Mapping(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One import mapping.

    Attributes:
        format: One of FORMATS; a table may be gzip-compressed.
        time: The column of time stamps, in s after scale and offset.
        command_time: That of the commands, on the same clock, where it is another one.
        command_kind: What the commands are.
        joints: At least one.
        name: Of the recording; {stem} is the file's name (or what `*` stands for), other names in
            braces are fields of the file's header.
        rows: json: the key under which the list of rows lies; empty: the file is the list, or
            has no other.
        files: Where measurements and commands lie in two files.
        topics: rosbag: where measurements and commands lie.
        servo_gain: Where a header field tells the servo's gain.
        released: Where a column tells that the servo was off.
        object: Where a free object's pose lies, if one was recorded.
    """

    format: str
    time: str | Column
    command_kind: CommandKind
    joints: list[JointColumns]
    name: str = "{stem}"
    rows: str = ""
    command_time: str | Column | None = None
    files: Files | None = None
    topics: Topics | None = None
    servo_gain: ServoGain | None = None
    released: Released | None = None
    object: ObjectColumns | None = None

    def __post_init__(self) -> None:
        names = [joint.name for joint in self.joints]
        if self.format not in FORMATS:
            raise ValueError(f"format is {self.format!r}, expected one of {', '.join(FORMATS)}")
        if not names or len(set(names)) != len(names):
            raise ValueError(f"joints are named {names}, expected each once, at least one")
        for signal in ("velocity", "effort"):
            given = [joint.name for joint in self.joints if getattr(joint, signal) is not None]
            if given and given != names:
                raise ValueError(f"{signal} only for {given}, expected for all joints or none")
        if self.servo_gain is not None and self.servo_gain.reference <= 0.0:
            raise ValueError(f"servo_gain.reference is {self.servo_gain.reference}, expected > 0")
        self._check_places()

    def _check_places(self) -> None:
        if self.released is not None and not self._one_table:
            raise ValueError("released needs measurements and commands in the same rows")
        if (self.topics is not None) != (self.format == "rosbag"):
            raise ValueError("topics belong to format rosbag, and rosbag needs topics")
        if self.files is not None and self.format not in TABLE_FORMATS:
            raise ValueError(f"files belong to tables; a {self.format} holds both")

    @property
    def _one_table(self) -> bool:
        apart = self.topics is not None and self.topics.states != self.topics.commands
        return self.files is None and not apart and self.command_time is None

    @property
    def columns(self) -> set[str]:
        """The columns of all joints' signals."""
        given = (getattr(joint, signal) for joint in self.joints for signal in SIGNALS)
        return {as_column(column).column for column in given if column is not None}


def load_mapping(path: Path) -> Mapping:
    """Returns the mapping in a TOML file.

    Raises:
        ConfigError: no such file, not TOML, an unknown key, or a value out of range.
    """
    try:
        text = path.read_text()
    except OSError as exc:
        raise ConfigError(f"{path}: {exc.strerror}; expected an import mapping") from exc
    except UnicodeDecodeError as exc:
        raise ConfigError(f"{path}: {exc}") from exc
    return mapping_of(text, str(path))


def mapping_of(text: str, where: str) -> Mapping:
    """Returns the mapping in a TOML text.

    Args:
        text: The mapping.
        where: Where it lies, for messages.

    Raises:
        ConfigError: not TOML, an unknown key, or a value out of range.
    """
    try:
        return msgspec.convert(tomllib.loads(text), Mapping)
    except (tomllib.TOMLDecodeError, msgspec.ValidationError) as exc:
        raise ConfigError(f"{where}: {exc}") from exc


def as_column(column: str | Column) -> Column:
    """Returns a column that was given by its name alone in full."""
    return Column(column=column) if isinstance(column, str) else column
