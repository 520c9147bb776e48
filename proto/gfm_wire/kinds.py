"""The kinds of field that a message may have: each packs, unpacks and describes itself.

Packing trusts the sender's own types; unpacking trusts nothing: whatever is not exactly what was
declared raises a WireError that names the field.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Generic, TypeVar, final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gfm.core import WireError

DTYPES = {"<f4": "float32", "<f8": "float64", "<i8": "int64"}
"""The element types that may cross the wire: little-endian, fixed width, no objects."""

INT64_MAX = 2**63 - 1


class Reason(StrEnum):
    """The words under which refused bodies are counted."""

    NOT_MSGPACK = "not_msgpack"
    TOO_LARGE = "too_large"
    TOO_DEEP = "too_deep"
    SCHEMA = "schema"
    VERSION = "version"
    FIELDS = "fields"
    TYPE = "type"
    RANGE = "range"
    DTYPE = "dtype"
    SHAPE = "shape"
    NOT_FINITE = "not_finite"


def wrong_type(where: str, got: object, expected: str) -> WireError:
    """Returns the error for a field that is not of its declared type."""
    return WireError(Reason.TYPE, f"{where} is {type(got).__name__}, expected {expected}")


V = TypeVar("V")
Word = TypeVar("Word", bound=StrEnum)


class Kind(ABC, Generic[V]):
    """One kind of field, of values V."""

    @abstractmethod
    def pack(self, value: V) -> object:
        """Returns what msgpack shall write."""

    @abstractmethod
    def unpack(self, body: object, where: str) -> V:
        """Returns the value, or raises a WireError that says where and why not."""

    @abstractmethod
    def describe(self) -> str:
        """Returns the kind in words for the reference page."""


@final
@dataclass(frozen=True)
class Text(Kind[str]):
    """UTF-8 text of bounded length."""

    longest: int = 4096

    @override
    def pack(self, value: str) -> object:
        return str(value)

    @override
    def unpack(self, body: object, where: str) -> str:
        if not isinstance(body, str):
            raise wrong_type(where, body, "text")
        if len(body) > self.longest:
            raise WireError(
                Reason.RANGE, f"{where} has {len(body)} characters, limit {self.longest}"
            )
        return body

    @override
    def describe(self) -> str:
        return "text"


@final
@dataclass(frozen=True)
class Choice(Kind[Word]):
    """One of the words of an enumeration."""

    words: type[Word]

    @override
    def pack(self, value: Word) -> object:
        return str(value)

    @override
    def unpack(self, body: object, where: str) -> Word:
        if not isinstance(body, str):
            raise wrong_type(where, body, "text")
        try:
            return self.words(body)
        except ValueError as exc:
            raise WireError(
                Reason.RANGE, f"{where} is {body[:40]!r}, expected {self.describe()}"
            ) from exc

    @override
    def describe(self) -> str:
        return " or ".join(f'"{word}"' for word in self.words)


@final
@dataclass(frozen=True)
class Integer(Kind[int]):
    """A 64-bit integer, not smaller than `least`."""

    least: int = -INT64_MAX

    @override
    def pack(self, value: int) -> object:
        return int(value)

    @override
    def unpack(self, body: object, where: str) -> int:
        if not isinstance(body, int) or isinstance(body, bool):
            raise wrong_type(where, body, "an integer")
        if not self.least <= body <= INT64_MAX:
            raise WireError(
                Reason.RANGE, f"{where} is {body}, expected {self.least} to {INT64_MAX}"
            )
        return body

    @override
    def describe(self) -> str:
        return "integer" if self.least == -INT64_MAX else f"integer ≥ {self.least}"


@final
@dataclass(frozen=True)
class Number(Kind[float]):
    """A float64; a gauge may be NaN or infinite: that is news, not an error."""

    @override
    def pack(self, value: float) -> object:
        return float(value)

    @override
    def unpack(self, body: object, where: str) -> float:
        if not isinstance(body, float):
            raise wrong_type(where, body, "a float")
        return body

    @override
    def describe(self) -> str:
        return "float"


@final
@dataclass(frozen=True)
class Flag(Kind[bool]):
    """Yes or no."""

    @override
    def pack(self, value: bool) -> object:
        return bool(value)

    @override
    def unpack(self, body: object, where: str) -> bool:
        if not isinstance(body, bool):
            raise wrong_type(where, body, "true or false")
        return body

    @override
    def describe(self) -> str:
        return "true or false"


@final
@dataclass(frozen=True)
class Array(Kind[NDArray[Any]]):
    """An array of finite numbers: {dtype, shape, data}, the data in C order.

    Attributes:
        dtype: One of DTYPES.
        letters: Its dimensions, separated by blanks; their number is checked here, their
            agreement with other fields by the value's own constructor. None takes any shape.
    """

    dtype: str
    letters: str | None

    @override
    def pack(self, value: NDArray[Any]) -> object:
        array = np.ascontiguousarray(value, dtype=self.dtype)
        return {"dtype": self.dtype, "shape": list(np.shape(value)), "data": array.tobytes()}

    @override
    def unpack(self, body: object, where: str) -> NDArray[Any]:
        if not isinstance(body, dict) or body.keys() != {"dtype", "shape", "data"}:
            raise wrong_type(where, body, "an array {dtype, shape, data}")
        if body["dtype"] != self.dtype:
            raise WireError(
                Reason.DTYPE, f"{where} has dtype {body['dtype']!r:.40}, expected {self.dtype!r}"
            )
        shape = self._shape(body["shape"], where)
        data = body["data"]
        if not isinstance(data, bytes):
            raise wrong_type(f"{where}.data", data, "bytes")
        array = self._filled(data, shape, where)
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise WireError(Reason.NOT_FINITE, f"{where} holds NaN or infinity")
        return array

    def _shape(self, body: object, where: str) -> tuple[int, ...]:
        if not isinstance(body, list) or not all(type(size) is int for size in body):
            raise wrong_type(f"{where}.shape", body, "a list of integers")
        if self.letters is not None and len(body) != len(self.letters.split()):
            raise WireError(
                Reason.SHAPE, f"{where} has shape {body!r:.60}, expected {self._dimensions}"
            )
        if not all(0 <= size <= INT64_MAX for size in body):
            raise WireError(
                Reason.SHAPE, f"{where} has shape {body!r:.60}, expected sizes of at least 0"
            )
        return tuple(body)

    def _filled(self, data: bytes, shape: tuple[int, ...], where: str) -> NDArray[Any]:
        needed = math.prod(shape) * np.dtype(self.dtype).itemsize
        if len(data) != needed:
            raise WireError(
                Reason.SHAPE, f"{where} of shape {shape} has {len(data)} bytes, expected {needed}"
            )
        try:
            # A copy of its own: torch wants to write, and the body can go.
            return np.frombuffer(data, dtype=self.dtype).reshape(shape).copy()
        except ValueError as exc:
            raise WireError(Reason.SHAPE, f"{where} has shape {shape}: {exc}") from exc

    @property
    def _dimensions(self) -> str:
        if self.letters is None:
            return "(any)"
        letters = self.letters.split()
        return f"({letters[0]},)" if len(letters) == 1 else f"({', '.join(letters)})"

    @override
    def describe(self) -> str:
        return f"{DTYPES[self.dtype]} {self._dimensions}"


@final
@dataclass(frozen=True)
class ListOf(Kind[tuple[V, ...]]):
    """A list of one kind; a tuple on our side."""

    item: Kind[V]

    @override
    def pack(self, value: tuple[V, ...]) -> object:
        return [self.item.pack(item) for item in value]

    @override
    def unpack(self, body: object, where: str) -> tuple[V, ...]:
        if not isinstance(body, list):
            raise wrong_type(where, body, "a list")
        return tuple(self.item.unpack(item, f"{where}[{i}]") for i, item in enumerate(body))

    @override
    def describe(self) -> str:
        return f"list of {self.item.describe()}"


@final
@dataclass(frozen=True)
class MapOf(Kind[Mapping[str, V]]):
    """A map from text to one kind."""

    item: Kind[V]

    @override
    def pack(self, value: Mapping[str, V]) -> object:
        return {str(key): self.item.pack(item) for key, item in value.items()}

    @override
    def unpack(self, body: object, where: str) -> Mapping[str, V]:
        if not isinstance(body, dict):
            raise wrong_type(where, body, "a map")
        name = Text()
        return {
            name.unpack(key, f"a key of {where}"): self.item.unpack(item, f"{where}[{key!r:.40}]")
            for key, item in body.items()
        }

    @override
    def describe(self) -> str:
        return f"map of text to {self.item.describe()}"


@final
@dataclass(frozen=True)
class Optional(Kind[V | None]):
    """One kind, or nil."""

    item: Kind[V]

    @override
    def pack(self, value: V | None) -> object:
        return None if value is None else self.item.pack(value)

    @override
    def unpack(self, body: object, where: str) -> V | None:
        return None if body is None else self.item.unpack(body, where)

    @override
    def describe(self) -> str:
        return f"{self.item.describe()}, or nil"
