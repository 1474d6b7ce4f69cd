"""`truewheel simulate gauge-session`: a gauge frame before all rigs of a station, each rig a little askew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from alignment.values import RigCalibration
from sensors.formats import GaugeFrame, PlateSession, PlateTruth
from sensors.simulation import (
    Optics,
    PlatePosition,
    PlateSessionSpec,
    draw_gauge_stand,
    simulate_plate_session,
    true_calibration,
)
from station.rehearsal.plate_simulation import write_simulated_session
from station.rehearsal.simulation import SimulationConfig


@dataclass(frozen=True, eq=False)
class SimulatedGaugeView:
    """What one rig saw, what was true, and its calibration until now: true cameras, nominal pose."""

    session: PlateSession
    truth: PlateTruth
    calibration: RigCalibration


def simulate_gauge_session(
    config: SimulationConfig, frame: GaugeFrame, seed: int, askew_deg: float = 0.3
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
    out = []
    for rig, gauge in frame.plates.items():
        stand = draw_gauge_stand(frame, rig, seed, askew_deg)
        calibration = true_calibration(rig, stand.side, config.rig, seed)
        spec = PlateSessionSpec(
            positions=(PlatePosition("gauge", rig_from_plate=stand.rig_from_plate),),
            flatness_errors=1.0,
            optics=Optics(**config.optics.model_dump()),
            settings=config.cameras.settings(),
        )
        session, truth = simulate_plate_session(
            spec, gauge.plate, calibration, stand.rng, seed=seed, time_utc=datetime.now(UTC)
        )
        out.append(
            SimulatedGaugeView(session, replace(truth, vehicle_from_rig=stand.vehicle_from_rig), calibration)
        )
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
