"""`truewheel simulate gauge-session`: a gauge frame before all rigs of a station, each rig a little askew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from alignment.units import ARCMIN
from alignment.values import RigCalibration, Side, nominal_vehicle_from_rig
from sensors.formats import GaugeFrame, PlateSession, PlateTruth
from sensors.simulation import (
    Optics,
    PlatePosition,
    PlateSessionSpec,
    simulate_plate_session,
    true_calibration,
)
from station.rehearsal.plate_simulation import write_simulated_session
from station.rehearsal.simulation import SimulationConfig

ASKEW_DEG = 0.3
"""By which rigs are turned from their plan, one standard deviation about each axis."""
_SHIFT_MM = 2.0  # by which they stand off then


@dataclass(frozen=True, eq=False)
class SimulatedGaugeView:
    """What one rig saw, what was true, and its calibration until now: true cameras, nominal pose."""

    session: PlateSession
    truth: PlateTruth
    calibration: RigCalibration


def simulate_gauge_session(
    config: SimulationConfig, frame: GaugeFrame, seed: int, askew_deg: float = ASKEW_DEG
) -> tuple[SimulatedGaugeView, ...]:
    """Render one view of a gauge frame by every rig.

    Each plate deviates from the frame's certificate, and its marks from the plate's description, within what
    these state; each rig stands off its plan by some tenths of a degree and millimetres.

    Parameters
    ----------
    config
        Rigs and cameras; tyre and light do not matter.
    frame
        As its certificate describes it; names the rigs.
    seed
        Of rigs, plates and noise. The cameras are those of `simulate_wheel` with the same seed.
    askew_deg
        By which rigs are turned from their plan about each axis, one standard deviation; they are shifted in
        proportion. Wheels are rendered before rigs that stand as planned, 0.
    """
    turn, shift_mm = math.radians(askew_deg), _SHIFT_MM * askew_deg / ASKEW_DEG
    out = []
    for number, (rig, gauge) in enumerate(frame.plates.items()):
        # Its own stream for each rig, another than wheels and plates of this seed draw from.
        rng = np.random.default_rng([seed, 3, number])
        outboard = gauge.vehicle_from_plate.rotation[:, 2]
        side: Side = "left" if outboard[1] > 0 else "right"
        calibration = true_calibration(rig, side, config.rig, seed)
        plate_stands = gauge.vehicle_from_plate.perturbed(
            rng.normal(0.0, frame.file.angle_sigma_arcmin * ARCMIN, 3),
            rng.normal(0.0, frame.file.position_sigma_mm, 3),
        )
        rig_stands = nominal_vehicle_from_rig(side).perturbed(
            rng.normal(0.0, turn, 3),
            gauge.vehicle_from_plate.translation + rng.normal(0.0, shift_mm, 3),
        )
        spec = PlateSessionSpec(
            positions=(PlatePosition("gauge", rig_from_plate=rig_stands.inverse() @ plate_stands),),
            flatness_errors=1.0,
            optics=Optics(**config.optics.model_dump()),
            settings=config.cameras.settings(),
        )
        session, truth = simulate_plate_session(
            spec, gauge.plate, calibration, rng, seed=seed, time_utc=datetime.now(UTC)
        )
        out.append(SimulatedGaugeView(session, replace(truth, vehicle_from_rig=rig_stands), calibration))
    return tuple(out)


def write_gauge_session(folder: Path, rigs: Sequence[SimulatedGaugeView]) -> None:
    """Write a gauge session into a new folder: a simulated plate session for each rig, named as the rig.

    Raises
    ------
    FormatError
        When a folder of a rig holds something already or cannot be written.
    """
    for rig in rigs:
        write_simulated_session(folder / rig.session.rig, rig.session, rig.truth, rig.calibration)
