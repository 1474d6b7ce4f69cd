"""The marks of every image of a plate session, numbered by what tells: plate, stage, known cameras."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from alignment.arrays import Array
from alignment.calibration import CameraKey, PlateView, StagedNumberings, cameras_of_rig, numbered_by_stage
from alignment.imaging import (
    MarkObservations,
    Numberings,
    Orientation,
    Plate,
    PlateRefusal,
    number_marks,
    observe_plate,
    turned_to,
)
from alignment.values import Image, RigCalibration
from sensors.formats import PlateSession
from station.figures import Progress

MARKS_SHARE = 0.5
"""Of the time of a calibration that finding marks takes, for the progress."""

Looked = MarkObservations | PlateRefusal | Numberings
Refusals = list[tuple[str, CameraKey, PlateRefusal]]


@dataclass(frozen=True, eq=False)
class KnownCameras:
    """Cameras that are known, so that they tell which way round a plate is which looks the same turned.

    Attributes
    ----------
    calibration
        Of the rig; that it was knocked a little does not matter.
    rig_from_plate
        (3, 3) rotation by which the plate stands before the rig, within half of what maps it onto itself.
    """

    calibration: RigCalibration
    rig_from_plate: Array

    def y_axis(self, key: CameraKey) -> Array:
        """Direction (2,) in which the plate's y axis points in the image of a camera."""
        rotation = cameras_of_rig(self.calibration)[key].rig_from_camera.rotation
        direction: Array = (rotation.T @ self.rig_from_plate[:, 1])[:2]
        return direction


def observe_session(
    session: PlateSession, progress: Progress, known: KnownCameras | None = None
) -> tuple[tuple[PlateView, ...], Refusals]:
    """Marks of every image, as many images at a time as there are cores.

    Parameters
    ----------
    session
        Images and plate.
    progress
        Told how far it is.
    known
        What tells which way round a plate is that only its moves on the stage would tell; None where the
        cameras are still to be found.

    Returns
    -------
    tuple
        Views with what each camera saw, and the images in which the plate was not recognised.
    """
    jobs = [(view, key) for view in session.views for key in view.images]
    plates = {head: session.plate.seen_by(head) for head in session.heads}
    by_stage = session.plate.plate.pattern.orientation is Orientation.STAGE
    look: Callable[[Image, Plate], Looked] = (
        number_marks if by_stage else partial(observe_plate, corrected=False)
    )
    found: dict[tuple[str, CameraKey], Looked] = {}
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        results = pool.map(lambda job: look(job[0].images[job[1]], plates[job[1][0]]), jobs)
        for n, ((view, key), result) in enumerate(zip(jobs, results, strict=True)):
            progress(MARKS_SHARE * n / len(jobs), f"marks of {view.name}, {' '.join(key)}")
            found[view.name, key] = result
    for key in session.sizes:
        found |= _told(session, key, found, known)
    marks = {at: one for at, one in found.items() if isinstance(one, MarkObservations)}
    refusals = [(*at, one) for at, one in found.items() if isinstance(one, PlateRefusal)]
    views = tuple(
        PlateView(
            view.name,
            view.stage_mm,
            {key: marks[view.name, key] for key in view.images if (view.name, key) in marks},
        )
        for view in session.views
    )
    return views, refusals


def _told(
    session: PlateSession,
    key: CameraKey,
    found: dict[tuple[str, CameraKey], Looked],
    known: KnownCameras | None,
) -> dict[tuple[str, CameraKey], Looked]:
    """What one camera saw, numbered with what all its views tell together."""
    views = [
        (view, one) for view in session.views if isinstance(one := found.get((view.name, key)), Numberings)
    ]
    numbered: tuple[MarkObservations | PlateRefusal, ...]
    if known is not None and key in cameras_of_rig(known.calibration):
        direction = known.y_axis(key)
        numbered = tuple(turned_to(one, direction, corrected=False) for _, one in views)
    else:
        staged = [
            StagedNumberings(None if view.stage_mm is None else np.asarray(view.stage_mm), one)
            for view, one in views
        ]
        numbered = numbered_by_stage(staged, corrected=False)
    return {(view.name, key): one for (view, _), one in zip(views, numbered, strict=True)}
