"""The messages between processes: name, version, fields, units; msgpack encode and decode."""

from typing import Any

Message = Any
