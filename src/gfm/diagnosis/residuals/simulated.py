"""Predictions that were simulated before.

A search asks for many of them again: for those of the hypothesis where it stands beside each of its
candidates, for those of a candidate where its fit begins and where it is compared.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field

from gfm.sim.segment import Prediction, Segment

#: Bytes of predictions that are kept: those of some hundred candidates.
MOST_BYTES = 64_000_000


@dataclass
class Simulated:
    """What models predicted for segments, the latest of it; all copies of a problem share it.

    Attributes:
        most_bytes: How much is kept: what was asked for longest ago is dropped first.
    """

    most_bytes: int = MOST_BYTES
    _told: OrderedDict[tuple[Hashable, Segment], Prediction] = field(default_factory=OrderedDict)
    _bytes: int = 0

    def each(
        self,
        models: Sequence[Hashable],
        segments: Sequence[Segment],
        simulate: Callable[[list[int]], Sequence[Sequence[Prediction]]],
    ) -> list[list[Prediction]]:
        """Returns every model's prediction of every segment, models first.

        Args:
            models: All that predictions depend on beside the segment.
            segments: To be predicted.
            simulate: Returns the predictions of some of the models, by their numbers.
        """
        rows = {i: self._known(model, segments) for i, model in enumerate(models)}
        new = [i for i, row in rows.items() if row is None]
        for i, row in zip(new, simulate(new) if new else (), strict=True):
            rows[i] = list(row)
            for segment, prediction in zip(segments, row, strict=True):
                self._keep((models[i], segment), prediction)
        return [row for row in rows.values() if row is not None]

    def _known(self, model: Hashable, segments: Sequence[Segment]) -> list[Prediction] | None:
        """Returns what is known of a model, or None where a segment is not."""
        keys = [(model, segment) for segment in segments]
        if any(key not in self._told for key in keys):
            return None
        for key in keys:
            self._told.move_to_end(key)
        return [self._told[key] for key in keys]

    def _keep(self, key: tuple[Hashable, Segment], prediction: Prediction) -> None:
        for values in (prediction.position, prediction.effort):
            values.setflags(write=False)
        if key in self._told:
            self._bytes -= _size(self._told.pop(key))
        self._told[key] = prediction
        self._bytes += _size(prediction)
        while self._bytes > self.most_bytes:
            self._bytes -= _size(self._told.popitem(last=False)[1])


def _size(prediction: Prediction) -> int:
    return prediction.position.nbytes + prediction.effort.nbytes
