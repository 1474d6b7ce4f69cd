"""A plate session captured with the station's own cameras: which view comes next, and whether it is good.

Everything that talks to a person is handed in, so that a terminal, a screen and a test drive the same steps.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from typing import Protocol

import numpy as np

from alignment.calibration import CameraKey, GateLimits
from alignment.errors import ConfigurationError
from alignment.imaging import MarkObservations, PlateRefusal, observe_plate
from alignment.values import SIDES, Image, Side
from sensors.formats import PlannedView, PlateDescription, PlateSession, SessionView
from sensors.shot import WheelShot
from station.maintenance.coverage import SeenView, movement_px

_NOW = partial(datetime.now, UTC)
STILL_PX = 0.3
"""Movement between two shots below which a plate stands still."""
_MOVED_PX = 5.0  # from the view before, by which a plate was put elsewhere
_MOST_SHOTS = 100_000


class PlateRig(Protocol):
    """What is needed of a rig; `station.maintenance.opened.WorkRig` is one."""

    @property
    def name(self) -> str:
        """Of the rig."""
        ...

    def arm(self) -> None:
        """Begin to look at the plate's next position."""
        ...

    def shoot_unlit(self) -> WheelShot:
        """Take a shot without the projector's lines."""
        ...


@dataclass(frozen=True, eq=False)
class PlateShot:
    """One shot of the plate.

    Attributes
    ----------
    images
        By head and side.
    marks
        What was recognised, by head and side.
    problems
        What is wrong with it, a sentence each; none for a good view.
    """

    images: Mapping[CameraKey, Image]
    marks: Mapping[CameraKey, MarkObservations]
    problems: tuple[str, ...]


def look_at_plate(
    shot: WheelShot, plate: PlateDescription, by_all: bool, limits: GateLimits | None = None
) -> PlateShot:
    """Find the plate in all images of a shot, and say what makes it no view of a session.

    Parameters
    ----------
    shot
        Of the rig.
    plate
        That stands there.
    by_all
        Whether every camera must see it, as on the stage; a plate held by hand may be out of some's sight.
    limits
        Of the gate: blur and contrast that it would refuse.
    """
    limits = limits or GateLimits()
    images = {
        (head.name, side): frame.image
        for head in shot.heads
        for side, frame in zip(SIDES, (head.left, head.right), strict=True)
    }
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        found = pool.map(
            lambda key: observe_plate(images[key], plate.seen_by(key[0]), corrected=False), images
        )
        results = dict(zip(images, found, strict=True))
    marks = {key: seen for key, seen in results.items() if isinstance(seen, MarkObservations)}
    problems = []
    for key, seen in results.items():
        name = " ".join(key)
        if isinstance(seen, PlateRefusal):
            if by_all or not marks:
                problems.append(f"{name}: {seen.reason}")
        elif seen.blur_px is not None and seen.blur_px > limits.blur_warned_px:
            problems.append(
                f"{name}: the marks' edges are blurred over {seen.blur_px:.1f} px, up to "
                f"{limits.blur_warned_px:g} px is sharp; focus the camera, or hold the plate still"
            )
        elif seen.contrast is not None and seen.contrast < limits.contrast_warned:
            problems.append(
                f"{name}: the marks stand out by only {seen.contrast:.0f} times the noise, at least "
                f"{limits.contrast_warned:g} times is good; add light, or lengthen the exposure"
            )
    return PlateShot(images, marks, tuple(problems))


@dataclass
class PlateCapture:
    """A plate session under way.

    Attributes
    ----------
    rig
        Armed at every view.
    side
        Of the vehicle.
    plate
        That is moved.
    stage_tolerance_mm
        Each stage coordinate is right within ± this.
    now
        Aware UTC time.
    began
        When the first view was taken.
    views, seen
        What was taken so far, and what the cameras saw of it.
    """

    rig: PlateRig
    side: Side
    plate: PlateDescription
    stage_tolerance_mm: float = 0.01
    now: Callable[[], datetime] = _NOW
    began: datetime | None = None
    views: list[SessionView] = field(default_factory=list)
    seen: list[SeenView] = field(default_factory=list)

    def shoot(self, planned: PlannedView, by_all: bool = False) -> PlateShot:
        """Take a shot of the plate in a position; it is not kept yet.

        On the stage every camera must see the plate; elsewhere too where it must be seen `by_all`.
        """
        return look_at_plate(self.rig.shoot_unlit(), self.plate, by_all or planned.on_stage)

    def wait_still(
        self, planned: PlannedView, seconds: float, clock: Callable[[], float] = time.monotonic
    ) -> PlateShot:
        """Shoot until a good view of the plate stands elsewhere than before, and still; return the last shot.

        The plate stands still when no camera sees its marks move by more than `STILL_PX` between two shots.
        When that did not come within so many seconds the last shot has a problem that says so.
        """
        until_s, before = clock() + seconds, None
        for _ in range(_MOST_SHOTS):
            shot = self.shoot(planned)
            elsewhere = not self.seen or movement_px(self.seen[-1].marks, shot.marks) > _MOVED_PX
            still = before is not None and movement_px(before.marks, shot.marks) < STILL_PX
            if shot.marks and elsewhere and still and not shot.problems:
                return shot
            before = shot
            if clock() >= until_s:
                break
        assert before is not None
        late = f"no good view of the plate within {seconds:g} s"
        if before.marks and not before.problems:
            late += ": it was not moved, or did not stand still"
        return replace(before, problems=(late, *before.problems))

    def keep(self, planned: PlannedView, shot: PlateShot, stage_mm: Sequence[float] | None = None) -> None:
        """Take a shot as a view of the session.

        Parameters
        ----------
        planned
            Where the plate was put.
        shot
            Without problems.
        stage_mm
            What the stage says where that is not as planned.

        Raises
        ------
        ConfigurationError
            When it has problems.
        """
        if shot.problems:
            raise ConfigurationError(expected="a view without problems", seen="; ".join(shot.problems))
        if self.began is None:
            self.began = self.now()
        staged = None
        if planned.on_stage:
            staged = np.array(planned.stage_mm if stage_mm is None else stage_mm, dtype=float)
        self.views.append(SessionView(planned.name, staged, {key: shot.images[key] for key in shot.marks}))
        self.seen.append(SeenView(planned, shot.marks))

    def sizes(self) -> dict[CameraKey, tuple[int, int]]:
        """(width, height) of each camera that saw the plate."""
        return {
            key: (image.shape[1], image.shape[0]) for view in self.views for key, image in view.images.items()
        }

    def session(self) -> PlateSession:
        """Return the session as it is written.

        Raises
        ------
        ConfigurationError
            When nothing was taken.
        """
        if self.began is None:
            raise ConfigurationError(
                field="views", expected="at least one view of the plate", seen="none was taken"
            )
        return PlateSession(
            rig=self.rig.name,
            side=self.side,
            time_utc=self.began,
            plate=self.plate,
            sizes=self.sizes(),
            views=tuple(self.views),
            stage_tolerance_mm=self.stage_tolerance_mm,
        )


def instruction(planned: PlannedView) -> str:
    """Return what to do with the plate for a view."""
    if not planned.on_stage:
        x, y = (float(np.degrees(angle)) for angle in planned.tilt)
        axis, angle = ("x", x) if x else ("y", y)
        return f"tilt the plate by about {angle:+.0f}° about its {axis} axis, held still; no stage"
    x, y, z = planned.stage_mm
    return f"stage at x {x:+g}, y {y:+g}, z {z:+g} mm, the plate along its axes"
