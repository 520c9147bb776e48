"""How a residual is divided to be scored: into blocks in time, and into cells of frequencies.

Each block is turned into frequencies (DCT), where what is correlated in time is not. A cell is one
channel and joint in one octave of frequencies.

Shape letters: N numbers of a residual, B blocks, C cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from gfm.core.checks import Array
from gfm.diagnosis.inference.constants import LEAST_DISCREPANCY

#: Longest block, s, fewest measurements of one, and lower edges of the octaves, Hz.
BLOCK_S, BLOCK_LEAST, OCTAVES_HZ = 2.0, 8, (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)
#: Largest coefficient that counts, in units of the noise.
LARGEST = 1e6


class SegmentShape(NamedTuple):
    """What one segment's numbers are: channels x measurements x joints of them, in this order."""

    recording: int
    duration_s: float
    channels: int
    measurements: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Blocks:
    """How the numbers of a residual are divided.

    Attributes:
        pieces: Rows of each block, shape (channels, T, J).
        fold: The part of the data to which each number belongs, shape (N,).
        block: Its block, shape (N,).
        recording: The recording of each block, shape (B,).
        cell: Its cell, shape (N,).
        count: Coefficients of each cell in each block, shape (B, C).
        floor: Mean square that no right model falls below, shape (B, C).
        limit: Beyond what numbers count less in a fit, shape (N,). Here they count in full: a
            residual that is bent has another spectrum, and the tails of Student's t bear them.
        each_segment: Whether each segment is a part of the data.
    """

    pieces: tuple[NDArray[np.intp], ...]
    fold: NDArray[np.intp]
    block: NDArray[np.intp]
    recording: NDArray[np.intp]
    cell: NDArray[np.intp]
    count: Array
    floor: Array
    limit: Array | float
    each_segment: bool

    def spectrum(self, residual: Array) -> Array:
        """Returns a residual that counts in full in frequencies, block by block, shape (N,)."""
        out = np.empty_like(residual)
        for rows in self.pieces:
            out[rows] = dct(residual[rows], axis=1, norm="ortho")
        return np.asarray(np.clip(out, -LARGEST, LARGEST))

    def sums(self, values: Array) -> Array:
        """Returns the sum of values, shape (N,), over each block's cells, shape (B, C)."""
        index = self.block * self.count.shape[1] + self.cell
        sums = np.bincount(index, weights=values, minlength=self.count.size)
        return np.asarray(sums.reshape(self.count.shape))


def blocks_of(
    layout: Sequence[SegmentShape],
    joints: int,
    limit: Array | float = np.inf,
    *,
    each_segment: bool = False,
) -> Blocks:
    """Returns how a residual is divided.

    Its parts are recordings where there are several, else every other segment; or each segment is
    one, where there are few.

    Args:
        layout: What each segment's numbers are.
        joints: How many are measured.
        limit: Beyond what numbers count less in a fit, shape (N,); infinite for none.
        each_segment: Whether each segment is a part.
    """
    several = len({segment.recording for segment in layout}) > 1
    places = joints * max(segment.channels for segment in layout)
    size = sum(segment.channels * segment.measurements * joints for segment in layout)
    fold, block, cell = (np.empty(size, dtype=np.intp) for _ in range(3))
    pieces, owners = list[NDArray[np.intp]](), list[int]()
    start = 0
    for index, segment in enumerate(layout):
        turn = segment.recording if several else index % 2
        part = index if each_segment else turn
        for rows, octave in _pieces(segment, joints):
            rows = rows + start
            channel_and_joint = np.arange(rows.shape[0] * joints).reshape(-1, 1, joints)
            fold[rows], block[rows] = part, len(pieces)
            cell[rows] = channel_and_joint * len(OCTAVES_HZ) + octave[:, None]
            pieces.append(rows)
            owners.append(segment.recording)
        start += segment.channels * segment.measurements * joints
    cells = places * len(OCTAVES_HZ)
    each = np.bincount(block * cells + cell, minlength=len(pieces) * cells)
    count = each.reshape(-1, cells).astype(float)
    return Blocks(
        pieces=tuple(pieces),
        fold=fold,
        block=block,
        recording=np.array(owners, dtype=np.intp),
        cell=cell,
        count=count,
        floor=1.0 + LEAST_DISCREPANCY**2 * _of_joint(count) / np.maximum(count, 1.0),
        limit=limit,
        each_segment=each_segment,
    )


def _pieces(segment: SegmentShape, joints: int) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Returns a segment's blocks: their rows (channels, T, J), and the octave of each T."""
    shape = (segment.channels, segment.measurements, joints)
    rows = np.arange(np.prod(shape)).reshape(shape)
    most = segment.measurements // BLOCK_LEAST
    many = max(min(round(segment.duration_s / BLOCK_S), most), 1)
    parts = np.array_split(rows, many, axis=1)
    per_s = segment.measurements / max(segment.duration_s, 1e-9)
    hertz = [0.5 * np.arange(p.shape[1]) / p.shape[1] * per_s for p in parts]
    octaves = [np.searchsorted(OCTAVES_HZ, one, side="right") - 1 for one in hertz]
    return list(zip(parts, octaves, strict=True))


def _of_joint(count: Array) -> Array:
    """Returns how many numbers a cell's channel and joint have in each block, shape (B, C)."""
    octaves = len(OCTAVES_HZ)
    return np.repeat(count.reshape(len(count), -1, octaves).sum(axis=2), octaves, axis=1)
