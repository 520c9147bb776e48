"""Arrays of a ring in files that are mapped into memory: what was written outlives the process."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.lib.format import open_memmap
from numpy.typing import NDArray

from gfm.core import BadInputError

_FORMAT = "gfm.replay/1"
_COUNTS, _RANDOM = "counts", "random.json"

Arrays = dict[str, NDArray[Any]]


@final
class RingFiles:
    """One folder: an array per file, a file that says what they are, and a random state.

    Attributes:
        folder: Where they are.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def exist(self) -> bool:
        """Whether there is a ring in the folder; it is there as a whole or not at all."""
        return self._meta.is_file()

    def make(
        self,
        spec_digest: str,
        shapes: Mapping[str, tuple[int, ...]],
        dtypes: Mapping[str, type[np.generic]],
    ) -> tuple[Arrays, NDArray[np.int64]]:
        """Returns new arrays, and two counts that begin at zero."""
        self.folder.mkdir(parents=True, exist_ok=True)
        arrays: Arrays = {
            name: open_memmap(self._file(name), mode="w+", dtype=dtypes[name], shape=shape)
            for name, shape in shapes.items()
        }
        counts = open_memmap(self._file(_COUNTS), mode="w+", dtype=np.int64, shape=(2,))
        self._meta.write_text(json.dumps({"format": _FORMAT, "spec_digest": spec_digest}))
        return arrays, counts

    def open(self, names: Sequence[str]) -> tuple[str, Arrays, NDArray[np.int64]]:
        """Returns digest, arrays and counts as they were left.

        Raises:
            BadInputError: a file is missing, damaged, or of another format.
        """
        try:
            meta = json.loads(self._meta.read_text(encoding="utf-8"))
            if meta["format"] != _FORMAT:
                raise BadInputError(f"{self._meta}: {meta['format']!r}, expected {_FORMAT!r}")
            arrays: Arrays = {name: open_memmap(self._file(name), mode="r+") for name in names}
            counts = open_memmap(self._file(_COUNTS), mode="r+")
            return str(meta["spec_digest"]), arrays, counts
        except (OSError, ValueError, KeyError, TypeError) as exc:
            raise BadInputError(f"{self.folder}: damaged replay: {exc}") from exc

    def save_random(self, rng: np.random.Generator) -> None:
        """Keeps the state of `rng` for the next life."""
        if self.exist:
            state = json.dumps(rng.bit_generator.state)
            (self.folder / _RANDOM).write_text(state, encoding="utf-8")

    def restore_random(self, rng: np.random.Generator) -> None:
        """Goes on with the state that was kept, if there is one, in place.

        Raises:
            BadInputError: what was kept is not a random state.
        """
        path = self.folder / _RANDOM
        if not path.is_file():
            return
        try:
            rng.bit_generator.state = json.loads(path.read_text(encoding="utf-8"))
        except (ValueError, KeyError, TypeError) as exc:
            raise BadInputError(f"{path}: no random state: {exc}") from exc

    @property
    def _meta(self) -> Path:
        return self.folder / "ring.json"

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.npy"
