"""`truewheel simulate wheel`: one rendered wheel, its truth and its true calibration."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from alignment.values import RigCalibration, Side
from sensors.formats import StrictModel, TyreLoad, WheelTruth, write_calibration, write_shot, write_truth
from sensors.shot import WheelShot
from sensors.simulation import (
    RIG_SPECS,
    TRUE_CALIBRATION_METHOD,
    TRUE_CALIBRATION_UTC,
    LinePattern,
    Optics,
    RigSpec,
    WheelPose,
    draw_scene,
    simulate_shot,
    true_calibration,
    truth_of,
)
from station.configuration import CameraOptions, read_toml


class OpticsOptions(StrictModel):
    """What the simulated cameras make of light."""

    blur_px: float = Field(default=0.7, ge=0, le=5, description="Standard deviation of the lens blur, pixels")
    full_well_e: float = Field(
        default=10_000.0, ge=100, le=1e6, description="Electrons at full scale; more means less shot noise"
    )
    read_noise_e: float = Field(default=12.0, ge=0, le=1000, description="Noise in the dark, electrons")
    bits: Literal[8, 16] = Field(default=8, description="Bits of a pixel")


class PatternOptions(StrictModel):
    """The grid of light, as it falls on a plane at the rig's distance."""

    columns: int = Field(default=13, ge=1, le=200, description="Lines across the projector's x axis")
    rows: int = Field(default=9, ge=1, le=200, description="Lines across the projector's y axis")
    column_pitch_mm: float = Field(default=15.0, gt=0, le=200, description="Spacing of the columns")
    row_pitch_mm: float = Field(default=17.0, gt=0, le=200, description="Spacing of the rows")
    width_mm: float = Field(default=0.7, gt=0, le=20, description="Width of a line")
    edge_mm: float = Field(default=0.3, gt=0, le=20, description="Softness of its edges, standard deviation")

    @model_validator(mode="after")
    def _is_pattern(self) -> PatternOptions:
        self.pattern()
        return self

    def pattern(self) -> LinePattern:
        """Return the value that the renderer takes."""
        return LinePattern(**self.model_dump())


class SimulationConfig(StrictModel):
    """What a simulation file holds; every field may be left out."""

    rig: Literal["standard", "dense", "central", "ccir"] = Field(
        default="standard", description="Geometry, cameras and light of the rig"
    )
    tyre: Literal["touring", "sport", "van", "low_profile"] = Field(
        default="touring", description="Shape of the tyre"
    )
    ambient: float = Field(
        default=0.15, ge=0, le=10, description="Light from all around; 8 is the projector's"
    )
    pattern: PatternOptions | None = Field(default=None, description="Another grid than the rig's own")
    optics: OpticsOptions = Field(default=OpticsOptions(), description="Blur, noise and bits of the cameras")
    cameras: CameraOptions = Field(default=CameraOptions(), description="Exposure and gain")

    def spec(self) -> RigSpec:
        """Return the rig."""
        spec = RIG_SPECS[self.rig]
        return spec if self.pattern is None else replace(spec, pattern=self.pattern.pattern())


def read_simulation(path: Path | None) -> SimulationConfig:
    """Read a simulation file; the defaults without one. Errors as `station.toml.read_toml`."""
    return SimulationConfig() if path is None else read_toml(SimulationConfig, path, "a simulation")


def simulate_wheel(
    config: SimulationConfig, side: Side, pose: WheelPose, seed: int, load: TyreLoad | None = None
) -> tuple[WheelShot, WheelTruth, RigCalibration]:
    """Render one wheel with all cameras of its rig: the shot, the truth, the true calibration.

    Parameters
    ----------
    config
        Rig, tyre, light, cameras.
    side
        Side of the vehicle; the rig is called ``front_left`` or ``front_right``.
    pose
        How the wheel stands.
    seed
        Of rig, tyre and noise: the same again gives the same images.
    load
        What the road does to the tyre; None for a wheel in the air.
    """
    calibration = true_calibration(f"front_{side}", side, config.rig, seed)
    rng = np.random.default_rng([seed, 1])
    drawn = draw_scene(config.spec(), side, pose, rng, config.tyre, seed=seed)
    scene = replace(drawn, ambient=config.ambient, optics=Optics(**config.optics.model_dump()), load=load)
    shot = simulate_shot(
        scene, calibration, rng, settings=config.cameras.settings(), time_utc=datetime.now(UTC)
    )
    return shot, truth_of(scene), calibration


def write_simulated_wheel(
    folder: Path, shot: WheelShot, truth: WheelTruth, calibration: RigCalibration
) -> None:
    """Write shot, ``truth.json`` and ``calibration.json`` into a new folder.

    Raises
    ------
    FormatError
        When the folder holds something already or cannot be written.
    """
    write_shot(folder, shot)
    write_truth(folder / "truth.json", truth)
    write_calibration(
        folder / "calibration.json",
        calibration,
        method=TRUE_CALIBRATION_METHOD,
        created_utc=TRUE_CALIBRATION_UTC,
    )
