"""`truewheel simulate wheel`: one rendered wheel that stands or turns, its truth and its true calibration."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from alignment.values import RigCalibration, Side
from sensors.formats import StrictModel, WheelTruth, write_calibration, write_shot, write_truth
from sensors.shot import WheelShot
from sensors.simulation import (
    RIG_SPECS,
    TRUE_CALIBRATION_METHOD,
    TRUE_CALIBRATION_UTC,
    LinePattern,
    Optics,
    RigSpec,
    Road,
    Rollers,
    TurningWheel,
    WheelPose,
    WheelScene,
    draw_scene,
    mean_truth,
    simulate_shot,
    true_calibration,
    truth_of,
)
from station.configuration import CameraOptions, read_toml

_AIR = Road()


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

    rig: Literal["standard", "dense", "central", "lifted", "upper", "turned", "ccir"] = Field(
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
    config: SimulationConfig, side: Side, pose: WheelPose, seed: int, road: Road = _AIR
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
    road
        What the wheel stands on, and how round it is; its rollers stand still.
    """
    calibration = true_calibration(f"front_{side}", side, config.rig, seed)
    rng = np.random.default_rng([seed, 1])
    scene = _scene(config, side, pose, seed, rng, road)
    shot = simulate_shot(
        scene, calibration, rng, settings=config.cameras.settings(), time_utc=datetime.now(UTC)
    )
    return shot, truth_of(scene), calibration


def _scene(
    config: SimulationConfig,
    side: Side,
    pose: WheelPose,
    seed: int,
    rng: np.random.Generator,
    road: Road,
) -> WheelScene:
    drawn = draw_scene(config.spec(), side, pose, rng, config.tyre, seed=seed)
    optics = Optics(**config.optics.model_dump())
    return replace(drawn, ambient=config.ambient, optics=optics, load=road.load, wobble=road.wobble)


def simulate_turning_wheel(
    config: SimulationConfig,
    side: Side,
    pose: WheelPose,
    seed: int,
    road: Road,
    exposures: int,
) -> tuple[Iterator[tuple[WheelShot, WheelTruth]], RigCalibration]:
    """Render a wheel that rollers turn: its exposures with the truth of each, and the true calibration.

    Arguments as `simulate_wheel`; rig and tyre are those of the wheel that stands still. The images of an
    exposure are rendered when it is asked for.
    """
    calibration = true_calibration(f"front_{side}", side, config.rig, seed)
    rng = np.random.default_rng([seed, 1])
    scene = _scene(config, side, pose, seed, rng, road)
    settings = config.cameras.settings()
    wheel = TurningWheel(
        scene, road.rollers or Rollers(), np.random.default_rng([seed, 2]), settings.exposure_ms
    )

    def exposure(number: int) -> tuple[WheelShot, WheelTruth]:
        seen = wheel.exposure(number)
        shot = simulate_shot(
            seen, calibration, rng, settings=settings, time_utc=datetime.now(UTC), trigger_counter=number
        )
        return shot, truth_of(seen)

    return (exposure(number) for number in range(1, exposures + 1)), calibration


def write_turning_wheel(
    folder: Path, exposures: Iterable[tuple[WheelShot, WheelTruth]], calibration: RigCalibration
) -> WheelTruth:
    """Write ``turn_01`` … with the truth of each, ``truth.json`` of the mean axis and ``calibration.json``.

    Returns
    -------
    WheelTruth
        Of the mean axis.

    Raises
    ------
    FormatError
        When the folder holds something already or cannot be written.
    """
    truths = []
    for number, (shot, truth) in enumerate(exposures, start=1):
        write_shot(folder / f"turn_{number:02d}", shot)
        write_truth(folder / f"turn_{number:02d}" / "truth.json", truth)
        truths.append(truth)
    mean = mean_truth(truths)
    write_truth(folder / "truth.json", mean)
    write_true_calibration(folder, calibration)
    return mean


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
    write_true_calibration(folder, calibration)


def write_true_calibration(folder: Path, calibration: RigCalibration) -> None:
    """Write the true cameras of a rig as its ``calibration.json``."""
    write_calibration(
        folder / "calibration.json",
        calibration,
        method=TRUE_CALIBRATION_METHOD,
        created_utc=TRUE_CALIBRATION_UTC,
    )
