"""The exposure assistant, before scenes that answer as light does: linear, with a ceiling, with sun."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sensors.camera import CameraSettings, Frame
from sensors.projectors.lit_rig import RigLight
from sensors.shot import HeadFrames, WheelShot
from station.maintenance.exposure import TARGET, ExposureLimits, exposure_in_toml, find_exposure
from tests.sensors.samples import TIME


def grid() -> np.ndarray:
    y, x = np.mgrid[:240, :320].astype(float)
    across = [0.995 * a + 0.1 * b for a, b in ((x, y), (y, -x))]
    near = np.minimum(*[np.abs((a + 15.0) % 30.0 - 15.0) for a in across])
    return np.exp(-0.5 * (near / 1.8) ** 2)


GRID = grid()


class LinearRig:
    """Two cameras, of which the right one sees `faint` of the left one's light.

    A line reaches full scale at 1 ms with `light` = 1 and full brightness, the ambient `sun` alike.
    """

    name = "front_left"

    def __init__(
        self, light: float, sun: float = 0.0, faint: float = 0.8, projector: bool = True, room: float = 0.0
    ) -> None:
        self.settings = CameraSettings(5.0)
        self.light = RigLight(1.0) if projector else None
        self.can_be_dark = projector
        self._lit, self._sun, self._faint, self._room = light, sun, faint, room
        self._rng = np.random.default_rng(1)
        self.shots = 0

    def arm(self, settings: CameraSettings, light: RigLight | None) -> None:
        self.settings = settings
        if light is not None:
            self.light = light

    def shoot(self) -> WheelShot:
        self.shots += 1
        return self._shot(self.light.brightness if self.light is not None else 1.0)

    def shoot_unlit(self) -> WheelShot:
        return self._shot(0.0 if self.light is not None else 1.0)

    def _shot(self, brightness: float) -> WheelShot:
        frames = []
        for side, share in (("left", 1.0), ("right", self._faint)):
            radiance = brightness * self._lit * GRID + self._room
            radiance[:80, :120] += self._sun
            grey = 6.0 + 255.0 * share * radiance * self.settings.exposure_ms
            grey += self._rng.normal(0.0, 1.0, grey.shape)
            image = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
            frames.append(Frame(f"front_left/head_1/{side}", image, 1, 0.0, 0.0, self.settings.exposure_ms))
        return WheelShot("front_left", TIME, (HeadFrames("head_1", *frames),))


Made = Callable[..., LinearRig]


@pytest.mark.parametrize("light", [0.02, 0.1, 1.0, 5.0])
@pytest.mark.parametrize("projector", [True, False])
def test_lines_become_bright_and_nothing_saturates_from_wherever_it_begins(
    light: float, projector: bool
) -> None:
    rig = LinearRig(light, projector=projector)
    found = find_exposure(rig, limits=ExposureLimits(0.05, 100.0))  # type: ignore[arg-type]
    assert found.good, found
    best = max(each.level for each in found.cameras)
    assert best == pytest.approx(TARGET, abs=0.09)
    assert all(each.saturated < 0.003 for each in found.cameras)
    assert found.warnings == ()
    if projector:
        assert found.light is not None
        assert found.light.brightness <= 0.85, "what is left is for the wear"
    assert rig.shots <= 8


def test_a_bright_projector_is_dimmed_when_the_exposure_cannot_be_shorter() -> None:
    found = find_exposure(LinearRig(5.0), limits=ExposureLimits(2.0, 2.0))  # type: ignore[arg-type]
    assert found.good
    assert found.settings.exposure_ms == 2.0
    assert found.light is not None
    assert found.light.brightness == pytest.approx(0.075, abs=0.02)


def test_too_little_light_is_told_with_what_to_do() -> None:
    found = find_exposure(LinearRig(0.005), limits=ExposureLimits(0.1, 20.0))  # type: ignore[arg-type]
    assert not found.good
    assert found.settings.exposure_ms == 20.0
    assert "open the lenses' apertures" in found.warnings[0]
    assert found.light is not None
    assert found.light.brightness == 1.0


def test_too_much_light_is_told() -> None:
    found = find_exposure(LinearRig(50.0, projector=False), limits=ExposureLimits(0.1, 20.0))  # type: ignore[arg-type]
    assert not found.good
    assert "stays too bright" in found.warnings[0]


@pytest.mark.parametrize(("sun", "dark"), [(0.0, False), (0.005, False), (0.06, True)])
def test_sun_beside_the_lines_is_warned_of_and_worth_a_dark_exposure(sun: float, dark: bool) -> None:
    found = find_exposure(LinearRig(0.1, sun))  # type: ignore[arg-type]
    assert found.light is not None
    assert found.light.dark is dark
    assert any("sun or lamps" in warning for warning in found.warnings) is dark
    assert found.ambient == pytest.approx(sun / 0.1, abs=0.1)
    assert f"dark = {str(dark).lower()}" in exposure_in_toml("front_left", found)


def test_a_camera_that_sees_hardly_any_line_is_named() -> None:
    found = find_exposure(LinearRig(0.1, faint=0.05))  # type: ignore[arg-type]
    assert any("front_left/head_1/right: " in warning for warning in found.warnings)


def test_a_plate_is_exposed_by_the_light_of_the_room() -> None:
    rig = LinearRig(0.0, room=0.05)
    found = find_exposure(rig, "plate")  # type: ignore[arg-type]
    assert found.good
    assert found.light is None
    assert found.settings.exposure_ms == pytest.approx(TARGET / 0.05, rel=0.15)
