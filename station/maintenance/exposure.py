"""The exposure assistant: shoots until the lines are bright and nothing saturates.

The brightest camera decides, since all are told the same exposure. A short exposure with a bright
projector is best: sun and lamps shine for the whole exposure, the projector as bright as it can.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from alignment.counting import listed
from alignment.imaging import extract_light_lines, full_scale, line_brightness, saturated_share
from alignment.values import Image
from sensors.camera import CameraSettings
from sensors.projectors import RigLight
from sensors.shot import WheelShot
from station.maintenance.opened import WorkRig

LookedAt = Literal["lines", "plate"]
TARGET = 0.75
"""Share of full scale that the brightest camera's lines, or its plate, shall reach."""
_NEAR = 0.08  # of full scale about the target
_MOST_SATURATED = 0.002  # of a camera's pixels
_SHOTS = 8
_RESERVE = 0.8  # of the projector's light: what is left is for its wear
_OVERSHOT = 0.35  # of the light is taken where it is not known how much there is too much
_LEAST_LINES = 0.1  # light of the lines over their ground in the faintest camera
_MOST_BLACK = 0.05  # of full scale, that a camera delivers without any light
_LEAST_STEP, _MOST_STEP = 0.02, 30.0
SUN_SHARE = 0.25
"""Ambient light over that of the lines from which it is worth to be subtracted."""


@dataclass(frozen=True)
class ExposureLimits:
    """Between which exposures is looked, milliseconds; equal ones leave the brightness to be found."""

    shortest_ms: float = 0.1
    longest_ms: float = 20.0


@dataclass(frozen=True)
class SeenLight:
    """What one camera made of one shot; shares of full scale.

    Attributes
    ----------
    camera
        Its name.
    level
        Of the lines, or of the plate's bright ground: what only 5 % of it exceeds.
    black
        Of the darkest part, as far as that can be without light.
    saturated
        Share of its pixels at full scale.
    lines
        Light of the lines over their ground; None where there are none, or a plate is looked at.
    """

    camera: str
    level: float
    black: float
    saturated: float
    lines: float | None


@dataclass(frozen=True, eq=False)
class FoundExposure:
    """What to put into the configuration, and what to be warned of.

    Attributes
    ----------
    settings, light
        As found; light is None where the rig has no projector, or a plate was looked at.
    cameras
        What they made of the last shot.
    good
        Whether the brightest camera reached the target and none is saturated.
    ambient
        Sun and lamps over the light of the lines, in the camera that is worst off; None where it cannot
        be told.
    warnings
        Sentences.
    shots
        How many it took.
    """

    settings: CameraSettings
    light: RigLight | None
    cameras: tuple[SeenLight, ...]
    good: bool
    ambient: float | None
    warnings: tuple[str, ...]
    shots: int


def find_exposure(
    rig: WorkRig,
    seen: LookedAt = "lines",
    limits: ExposureLimits | None = None,
    told: Callable[[str], None] = lambda text: None,
) -> FoundExposure:
    """Find exposure and brightness for what stands before a rig; at most `_SHOTS` shots, and one in the dark.

    Parameters
    ----------
    rig
        With a usual wheel before it, or the plate.
    seen
        Which of them.
    limits
        Of the exposure.
    told
        Hears of every shot.
    """
    limits = limits or ExposureLimits()
    settings = replace(
        rig.settings, exposure_ms=min(max(rig.settings.exposure_ms, limits.shortest_ms), limits.longest_ms)
    )
    light = None if rig.light is None or seen == "plate" else replace(rig.light, dark=False)
    good, shots = False, 0
    cameras: tuple[SeenLight, ...] = ()
    for shots in range(1, _SHOTS + 1):
        rig.arm(settings, light)
        shot = rig.shoot() if seen == "lines" else rig.shoot_unlit()
        cameras = tuple(_seen(frame.camera, frame.image, seen) for frame in shot.frames)
        brightest = max(cameras, key=lambda each: (each.saturated > _MOST_SATURATED, each.level))
        told(_told(settings, light, brightest))
        saturated = brightest.saturated > _MOST_SATURATED
        good = not saturated and abs(brightest.level - TARGET) <= _NEAR
        if good or shots == _SHOTS:
            break
        factor = _OVERSHOT if saturated else _factor(brightest)
        following = _changed(settings, light, factor, limits, adjustable=rig.can_be_dark)
        if following == (settings, light):
            break
        settings, light = following
    ambient: float | None = None
    dark_warnings: tuple[str, ...] = ()
    if seen == "lines" and rig.can_be_dark:
        ambient, dark_warnings = _ambient(rig.shoot_unlit(), shot)
    warnings = _warnings(cameras, good, seen, settings) + dark_warnings
    if light is not None and ambient is not None:
        light = replace(light, dark=ambient > SUN_SHARE)
    return FoundExposure(settings, light, cameras, good, ambient, warnings, shots)


def _seen(camera: str, image: Image, seen: LookedAt) -> SeenLight:
    top = full_scale(image)
    black, ground = (float(value) / top for value in np.percentile(image, (1.0, 95.0)))
    # Where everything is lit, the darkest part is not black.
    black = min(black, _MOST_BLACK)
    saturated = saturated_share(image)
    if seen == "plate":
        return SeenLight(camera, ground, black, saturated, None)
    lines = extract_light_lines(image)
    if lines is None or not len(lines.points):
        return SeenLight(camera, float(np.percentile(image, 99.9)) / top, black, saturated, None)
    x, y = np.rint(lines.points.T).astype(int)
    level = float(np.percentile(image[y, x], 95.0)) / top
    return SeenLight(camera, level, black, saturated, line_brightness(image, lines))


def _factor(brightest: SeenLight) -> float:
    """By how much more light the brightest camera would reach the target; light is linear above black."""
    above = brightest.level - brightest.black
    wanted = TARGET - brightest.black
    return min(max(wanted / max(above, 1e-3), _LEAST_STEP), _MOST_STEP)


def _changed(
    settings: CameraSettings, light: RigLight | None, factor: float, limits: ExposureLimits, adjustable: bool
) -> tuple[CameraSettings, RigLight | None]:
    """Return settings that give so much more light: the projector up to its reserve first, then longer."""
    brightness = 1.0 if light is None else light.brightness
    wanted = settings.exposure_ms * brightness * factor
    if light is None or not adjustable:
        exposure = min(max(wanted / brightness, limits.shortest_ms), limits.longest_ms)
        return replace(settings, exposure_ms=_rounded(exposure)), light
    exposure = min(max(wanted / _RESERVE, limits.shortest_ms), limits.longest_ms)
    exposure = _rounded(exposure)
    brightness = min(max(wanted / exposure, 0.01), 1.0)
    return replace(settings, exposure_ms=exposure), replace(light, brightness=round(brightness, 2))


def _rounded(exposure_ms: float) -> float:
    """Three digits."""
    return float(f"{exposure_ms:.3g}")


def _ambient(dark: WheelShot, lit: WheelShot) -> tuple[float, tuple[str, ...]]:
    """Sun and lamps over the light of the lines, where that is worst, and what to say of it."""
    worst, blinded = 0.0, []
    for without, frame in zip(dark.frames, lit.frames, strict=True):
        image, top = without.image, full_scale(frame.image)
        black, bright = (float(value) / top for value in np.percentile(image, (1.0, 99.5)))
        lines = extract_light_lines(frame.image)
        light = None if lines is None else line_brightness(frame.image, lines)
        worst = max(worst, (bright - black) / max(light or 0.0, 1e-3))
        if saturated_share(image) > _MOST_SATURATED:
            blinded.append(frame.camera)
    warnings = []
    if worst > SUN_SHARE:
        warnings.append(
            f"sun or lamps shine {worst:.0%} as bright as the light lines: screen the rig from them, or "
            "let their light be subtracted by a dark exposure"
        )
    if blinded:
        warnings.append(
            f"{listed(blinded)}: saturated without the projector's light; what is saturated cannot be "
            "subtracted, screen the rig"
        )
    return worst, tuple(warnings)


def _warnings(
    cameras: tuple[SeenLight, ...], good: bool, seen: LookedAt, settings: CameraSettings
) -> tuple[str, ...]:
    found = []
    brightest = max(cameras, key=lambda each: each.level)
    if not good and brightest.level < TARGET:
        more = 20.0 * math.log10(_factor(brightest))
        found.append(
            f"even {settings.exposure_ms:g} ms leave the brightest camera at {brightest.level:.0%} of "
            f"full scale: open the lenses' apertures, bring more light, or as a last resort a gain of "
            f"{more:.0f} dB, which brings noise"
        )
    elif not good:
        found.append(
            f"{brightest.camera} stays too bright at {settings.exposure_ms:g} ms: close the lenses' "
            "apertures, dim the light, or look for a reflection"
        )
    if seen == "lines":
        faint = [each for each in cameras if each.lines is None or each.lines < _LEAST_LINES]
        found += [
            f"{each.camera}: "
            + (
                "no light lines"
                if each.lines is None
                else f"faint light lines, {each.lines:.0%} of full scale"
            )
            + "; open its aperture, clean its window, and check where its projector points"
            for each in faint
        ]
    elif brightest.level > 0.0:
        found += [
            f"{each.camera}: {each.level:.0%} of full scale where {brightest.camera} has "
            f"{brightest.level:.0%}; light the plate evenly, or open its aperture"
            for each in cameras
            if each.level < 0.4 * brightest.level
        ]
    return tuple(found)


def _told(settings: CameraSettings, light: RigLight | None, brightest: SeenLight) -> str:
    lamp = "" if light is None else f", brightness {light.brightness:.2f}"
    state = "not saturated"
    if brightest.saturated > _MOST_SATURATED:
        state = f"{brightest.saturated:.1%} saturated"
    reached = f"{brightest.camera} reaches {brightest.level:.0%} of full scale"
    return f"{settings.exposure_ms:g} ms{lamp}: {reached}, {state}"


def exposure_in_toml(rig: str, found: FoundExposure) -> str:
    """Return what to put into the station's configuration."""
    lines = [
        "[cameras]",
        f"exposure_ms = {found.settings.exposure_ms:g}",
        f"gain_db = {found.settings.gain_db:g}",
    ]
    if found.light is not None:
        lines += [
            "",
            f"[rigs.projector]  # of {rig}",
            f"brightness = {found.light.brightness:g}",
            f"dark = {str(found.light.dark).lower()}",
        ]
    return "\n".join(lines)
