"""The port of every named effect: parameters with units and bounds, and how it acts in a model."""

from __future__ import annotations

from dataclasses import dataclass
