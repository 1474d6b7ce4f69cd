"""The master wheel: what is certified of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MasterWheel:
    """A wheel whose angles are certified, in the vehicle frame as it stands at the rig, radians.

    `u` is the standard uncertainty of both angles.
    """

    camber: float
    toe: float
    u: float = 0.0
    name: str = "master wheel"
