"""`truewheel simulate plate-session`: a rendered session, its truth, and the true cameras."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from alignment.errors import ConfigurationError
from alignment.values import RigCalibration, Side
from sensors.formats import (
    SHIFT_MM,
    TILT,
    PlateDescription,
    PlateSession,
    PlateTruth,
    write_calibration,
    write_plate_session,
    write_plate_truth,
)
from sensors.simulation import (
    TRUE_CALIBRATION_METHOD,
    TRUE_CALIBRATION_UTC,
    Optics,
    PlateSessionSpec,
    plate_positions,
    simulate_plate_session,
    true_calibration,
)
from station.rehearsal.simulation import SimulationConfig


def simulate_session(
    config: SimulationConfig,
    plate: PlateDescription,
    side: Side,
    seed: int,
    views: int = 7,
    head: str | None = None,
    shift_mm: float = SHIFT_MM,
) -> tuple[PlateSession, PlateTruth, RigCalibration]:
    """Render a plate session: the session, its truth, the true calibration.

    Parameters
    ----------
    config
        Rig and cameras; its tyre and light do not matter.
    plate
        As its maker describes it; its errors are drawn.
    side
        Side of the vehicle; the rig is called ``front_left`` or ``front_right``.
    seed
        Of rig, plate, stage and noise. The rig is the one of `simulate_wheel` with the same seed.
    views
        Positions of the plate.
    head
        When given, only this head looks, at a plate centred below it and tilted twice as far.
    shift_mm
        How far the shifted positions lie aside, along x and y.

    Raises
    ------
    ConfigurationError
        When the rig has no such head.
    """
    calibration = true_calibration(f"front_{side}", side, config.rig, seed)
    centre, tilt = (0.0, 0.0, 0.0), TILT
    if head is not None:
        names = [known.name for known in calibration.heads]
        if head not in names:
            raise ConfigurationError(choice="head", expected=f"one of {', '.join(names)}", seen=f"'{head}'")
        x, y, _ = config.spec().rig_from_head(names.index(head)).translation
        centre, tilt = (round(float(x), 1), round(float(y), 1), 0.0), 2.0 * TILT
    spec = PlateSessionSpec(
        positions=plate_positions(views, tilt, shift_mm),
        centre_mm=centre,
        heads=None if head is None else (head,),
        optics=Optics(**config.optics.model_dump()),
        settings=config.cameras.settings(),
    )
    # Another stream than the wheels of this seed draw from.
    rng = np.random.default_rng([seed, 2])
    session, truth = simulate_plate_session(
        spec, plate, calibration, rng, seed=seed, time_utc=datetime.now(UTC)
    )
    return session, truth, calibration


def write_simulated_session(
    folder: Path, session: PlateSession, truth: PlateTruth, calibration: RigCalibration
) -> None:
    """Write session, ``truth.json`` and ``calibration.json`` into a new folder.

    Raises
    ------
    FormatError
        When the folder holds something already or cannot be written.
    """
    write_plate_session(folder, session)
    write_plate_truth(folder / "truth.json", truth)
    write_calibration(
        folder / "calibration.json",
        calibration,
        method=TRUE_CALIBRATION_METHOD,
        created_utc=TRUE_CALIBRATION_UTC,
    )
