"""A schema: the fields of one dataclass on the wire, and the check of a body against them."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar, final

from typing_extensions import override

from gfm.core import GfmError, WireError
from gfm_wire.kinds import Kind, Reason, wrong_type

M = TypeVar("M")


@final
class Schema(Kind[M]):
    """How one value type crosses the wire; also a kind of field, where it is part of another."""

    def __init__(self, value_type: type[M], version: int, kinds: Mapping[str, Kind[Any]]) -> None:
        """Declares the kind of every field of `value_type`.

        Args:
            value_type: A frozen dataclass whose docstring describes its attributes.
            version: Grows with every change that an older reader would misunderstand.
            kinds: By field name; none may be missing.
        """
        names = {field.name for field in fields(value_type)}  # type: ignore[arg-type]
        if kinds.keys() != names:
            raise TypeError(f"{value_type.__name__}: declared {set(kinds)}, has {names}")
        self.value_type = value_type
        self.version = version
        self.kinds = kinds

    @property
    def name(self) -> str:
        """The schema's name on the wire."""
        return self.value_type.__name__

    @property
    def documentation(self) -> Mapping[str, str]:
        """What each field means, from the docstring of the value type."""
        return attribute_texts(inspect.getdoc(self.value_type) or "")

    @override
    def pack(self, value: M) -> object:
        return {name: kind.pack(getattr(value, name)) for name, kind in self.kinds.items()}

    @override
    def unpack(self, body: object, where: str) -> M:
        if not isinstance(body, dict):
            raise wrong_type(where, body, "a map")
        if body.keys() != self.kinds.keys():
            raise WireError(Reason.FIELDS, f"{where} {field_difference(body, self.kinds)}")
        values = {
            name: kind.unpack(body[name], f"{where}.{name}") for name, kind in self.kinds.items()
        }
        try:
            return self.value_type(**values)
        except GfmError as exc:  # the constructor checks what a single field cannot show
            raise WireError(Reason.SHAPE, f"{where}: {exc}") from exc

    @override
    def describe(self) -> str:
        return self.name


def field_difference(body: Mapping[Any, Any], expected: Mapping[str, Any]) -> str:
    """Says which fields a map lacks, and which it should not have."""
    lacking = sorted(expected.keys() - body.keys())
    unknown = sorted(str(name)[:40] for name in body.keys() - expected.keys())
    parts = []
    if lacking:
        parts.append(f"lacks {', '.join(lacking)}")
    if unknown:
        parts.append(f"has unknown fields {', '.join(unknown[:5])}")
    return " and ".join(parts)


def attribute_texts(docstring: str) -> dict[str, str]:
    """Returns the texts of a Google-style `Attributes:` section, by name."""
    _, _, section = docstring.partition("Attributes:\n")
    texts: dict[str, str] = {}
    name = ""
    for line in section.splitlines():
        if line.startswith("        "):
            texts[name] += f" {line.strip()}"
        elif line.startswith("    "):
            name, _, text = line.strip().partition(": ")
            texts[name] = text
    return texts
