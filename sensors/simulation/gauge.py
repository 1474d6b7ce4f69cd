"""A gauge frame before the rigs of a station, each of which stands a little askew."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from alignment.geometry import RigidTransform
from alignment.units import ARCMIN
from alignment.values import Side, nominal_vehicle_from_rig
from sensors.formats.gauge_frame import GaugeFrame

ASKEW_DEG = 0.3
"""By which rigs are turned from their plan, one standard deviation about each axis."""
_SHIFT_MM = 2.0  # by which they stand off then


@dataclass(frozen=True, eq=False)
class GaugeStand:
    """One rig before its plate of a gauge frame.

    Attributes
    ----------
    side
        Of the vehicle.
    vehicle_from_rig
        Where the rig really stands.
    rig_from_plate
        Where its plate is before it.
    rng
        Draws what else is drawn of this rig, plate and light.
    """

    side: Side
    vehicle_from_rig: RigidTransform
    rig_from_plate: RigidTransform
    rng: np.random.Generator


def draw_gauge_stand(frame: GaugeFrame, rig: str, seed: int, askew_deg: float = ASKEW_DEG) -> GaugeStand:
    """Draw where a rig of a gauge frame stands, and its plate within what the frame's certificate states.

    Parameters
    ----------
    frame
        As its certificate describes it; it must have a plate for this rig.
    rig
        Name of the rig.
    seed
        Of the station.
    askew_deg
        By which rigs are turned from their plan about each axis, one standard deviation; they are shifted in
        proportion.
    """
    turn, shift_mm = math.radians(askew_deg), _SHIFT_MM * askew_deg / ASKEW_DEG
    gauge = frame.plates[rig]
    # Its own stream for each rig, another than wheels and plates of this seed draw from.
    rng = np.random.default_rng([seed, 3, list(frame.plates).index(rig)])
    outboard = gauge.vehicle_from_plate.rotation[:, 2]
    side: Side = "left" if outboard[1] > 0 else "right"
    plate_stands = gauge.vehicle_from_plate.perturbed(
        rng.normal(0.0, frame.file.angle_sigma_arcmin * ARCMIN, 3),
        rng.normal(0.0, frame.file.position_sigma_mm, 3),
    )
    rig_stands = nominal_vehicle_from_rig(side).perturbed(
        rng.normal(0.0, turn, 3),
        gauge.vehicle_from_plate.translation + rng.normal(0.0, shift_mm, 3),
    )
    return GaugeStand(side, rig_stands, rig_stands.inverse() @ plate_stands, rng)
