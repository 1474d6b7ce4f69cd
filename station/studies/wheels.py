"""A simulated rig, calibrated from plate images, and wheels before it: what the wheel studies share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Singles
from alignment.calibration import CalibrationInput, adjust
from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from alignment.values import RigCalibration, Side, StereoImages, WheelMeasurement
from sensors.formats import PlateSession, read_plate
from sensors.simulation import (
    RIG_SPECS,
    PlateSessionSpec,
    RigSpec,
    WheelScene,
    build_rig,
    develop,
    light_on_chip,
    plate_positions,
    simulate_plate_session,
    truth_of,
)
from station.calibration import observe_session
from station.configuration import default_config

PLATE = "plates/rig.toml"


@dataclass(frozen=True, eq=False)
class StudyRig:
    """A rig as built: its nominal geometry and its true cameras, which only the scoring may use."""

    spec: RigSpec
    side: Side
    true: RigCalibration


def study_rig(preset: str, seed: int, side: Side = "left") -> StudyRig:
    """Build the rig of a preset; the same seed gives the same one."""
    spec = RIG_SPECS[preset]
    return StudyRig(spec, side, build_rig(spec, f"front_{side}", side, np.random.default_rng([seed, 0])))


def calibrate_from_plate(rig: StudyRig, seed: int, views: int = 7) -> RigCalibration:
    """Calibrate a rig jointly from rendered images of a plate; each seed has another plate, stage and noise.

    Raises
    ------
    DegenerateInputError
        When the plate is not recognised, or does not determine the cameras.
    """
    session, _ = simulate_plate_session(
        PlateSessionSpec(positions=plate_positions(views)),
        read_plate(default_config(None, PLATE)),
        rig.true,
        np.random.default_rng([seed, 2]),
    )
    adjustment = adjust(observed(session))
    return adjustment.rig_calibration(f"plate-{seed}", rig.true.rig, rig.side, rig.true.vehicle_from_rig)


def observed(session: PlateSession) -> CalibrationInput:
    """Marks of every image of a session of a whole rig.

    Raises
    ------
    DegenerateInputError
        When the plate is not recognised in an image.
    """
    views, refusals = observe_session(session, lambda _share, _what: None)
    if refusals:
        view, key, refusal = refusals[0]
        raise DegenerateInputError(
            field=f"{view}, {' '.join(key)}", expected="the plate", seen=refusal.reason
        )
    return CalibrationInput(session.plate.plate, views, dict(session.sizes), session.stage_sigma_mm)


def lights(scene: WheelScene, cameras: RigCalibration) -> list[tuple[Singles, Singles]]:
    """Light on the chips of each head's cameras, without noise: what rendering costs its time for."""
    return [
        (light_on_chip(scene, cameras, head, "left"), light_on_chip(scene, cameras, head, "right"))
        for head in range(len(cameras.heads))
    ]


def exposed(
    light: Sequence[tuple[Singles, Singles]],
    scene: WheelScene,
    rng: np.random.Generator,
    exposure_ms: float = 5.0,
) -> list[StereoImages]:
    """Images of that light, with noise of their own."""
    return [
        StereoImages(
            develop(left, scene.optics, rng, exposure_ms), develop(right, scene.optics, rng, exposure_ms)
        )
        for left, right in light
    ]


def errors_arcmin(result: WheelMeasurement, scene: WheelScene) -> tuple[float, float]:
    """Measured less true (camber, toe), arcminutes."""
    truth = truth_of(scene)
    return (
        (result.camber - math.radians(truth.camber_deg)) / ARCMIN,
        (result.toe - math.radians(truth.toe_deg)) / ARCMIN,
    )
