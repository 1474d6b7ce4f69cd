"""Which way round a camera sees a plate that looks the same turned: the stage's known moves tell.

On a stage the plate moves with its axes along the rig's. Each way round puts the camera elsewhere before the
plate, and only with the right one all positions of the stage agree on where the camera stands: turned by
half, a move to the right would be one to the left. The camera's lens is not known yet: square pixels, the
image's middle as principal point and the focal length with which the positions agree best are enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from alignment.arrays import Array
from alignment.calibration.planar import pose_of_plane
from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.mark_plane import PlaneView
from alignment.imaging.numbering import Numberings, nearest_turn, turned_to, undecided
from alignment.imaging.plate import MarkObservations
from alignment.imaging.plate_refusal import PlateRefusal, PlateRefusalCode

_CLEARLY = 0.4  # of the disagreement of the next way round, that of the right one at most
_LEAST_MOVE_MM = 0.5
_SHORTEST, _LONGEST = 0.3, 30.0  # focal length over the image's width
_MOST_VIEWS = 12
_NEAR_PLACE, _FAR_PLACE = 0.25, 0.6  # of the pitch, from where the other views put the camera


@dataclass(frozen=True, eq=False)
class StagedNumberings:
    """What one camera saw in one view.

    Attributes
    ----------
    stage_mm
        (3,) position of the stage; None for a plate that is not on it.
    found
        The marks, with every way to number them.
    """

    stage_mm: Array | None
    found: Numberings

    @property
    def is_whole(self) -> bool:
        """Whether only turns are left open, and no shift."""
        return len(np.unique(self.found.turns)) == len(self.found)


def numbered_by_stage(
    views: Sequence[StagedNumberings], *, corrected: bool
) -> tuple[MarkObservations | PlateRefusal, ...]:
    """Number the marks that one camera saw in several views.

    Parameters
    ----------
    views
        Of one camera and one plate.
    corrected
        As for `alignment.imaging.identify_marks`.

    Returns
    -------
    tuple
        For each view its marks, or why nothing tells. Views off the stage, such as tilted ones, are taken to
        be turned by less than half of what maps the plate onto itself.
    """
    settled = _settled(views)
    if isinstance(settled, PlateRefusal):
        return tuple(
            each.found.observations(0, corrected=corrected) if len(each.found) == 1 else settled
            for each in views
        )
    return tuple(_numbered(each, settled, corrected=corrected) for each in views)


@dataclass(frozen=True, eq=False)
class _Camera:
    """A camera as the views of the whole plate show it.

    Attributes
    ----------
    y_axis
        (2,) direction of the plate's y axis in its image.
    view
        How it saw the plate in one of them, for the lens.
    rotation, centre
        (3, 3) takes rig directions to the camera's; (3,) where it stands in the rig, millimetres.
    focal
        Pixels.
    """

    y_axis: Array
    view: PlaneView
    rotation: Array
    centre: Array
    focal: float

    def ideal(self, points: Array) -> Array:
        """Pixels (N, 2) of points (N, 3) of the rig, without distortion."""
        seen = (points - self.centre) @ self.rotation.T
        return self.view.middle + self.focal * seen[:, :2] / seen[:, 2:]


def _numbered(view: StagedNumberings, camera: _Camera, *, corrected: bool) -> MarkObservations | PlateRefusal:
    if view.is_whole or view.stage_mm is None:
        return turned_to(view.found, camera.y_axis, corrected=corrected)
    ways = nearest_turn(view.found, camera.y_axis)
    if ways is None:
        return undecided(view.found)
    found = view.found.only(ways)
    seen = camera.view.unbent(found.pixels)
    away = []
    for way in range(len(found)):
        points = found.plate.points[found.rows(way)]
        off = camera.ideal(points + view.stage_mm) - seen
        # In pitches: how far the camera would have to see the plate moved.
        beside = camera.ideal(points + view.stage_mm + [_least_pitch(found), 0.0, 0.0]) - seen
        away.append(float(np.hypot(*np.median(off, axis=0)) / np.hypot(*np.median(beside - off, axis=0))))
    order = np.argsort(away)
    if away[order[0]] > _NEAR_PLACE or (len(order) > 1 and away[order[1]] < _FAR_PLACE):
        return undecided(found)
    return found.observations(int(order[0]), corrected=corrected)


def _least_pitch(found: Numberings) -> float:
    plate = found.plate
    return float((np.ptp(plate.points[:, :2], axis=0) / np.ptp(plate.indices, axis=0)).min())


def _design(points: Array) -> Array:
    return np.column_stack([points, np.ones(len(points))]).astype(np.float64)


@dataclass(frozen=True, eq=False)
class _Seen:
    """One view on the stage: how its plane is seen, and what takes each way of numbering to the first."""

    stage_mm: Array
    plane: PlaneView
    ideal_from_plane: Array
    first_from: tuple[Array, ...]

    @classmethod
    def of(cls, view: StagedNumberings) -> _Seen:
        found = view.found
        points = [found.plate.points[found.rows(way), :2] for way in range(len(found))]
        plane = PlaneView.fit(points[0], found.pixels, found.size)
        moves = []
        for each in points:
            affine = np.linalg.lstsq(_design(each), points[0], rcond=None)[0]
            moves.append(np.vstack([affine.T, [0.0, 0.0, 1.0]]))
        assert view.stage_mm is not None
        ideal = np.asarray(np.linalg.inv(plane.plane_from_ideal), dtype=np.float64)
        return cls(np.asarray(view.stage_mm, dtype=np.float64), plane, ideal, tuple(moves))

    def pose(self, way: int, focal: float) -> RigidTransform:
        """camera_from_plate if the marks are numbered so and the lens is that long."""
        (x, y), f = self.plane.middle, focal
        matrix = np.array([[f, 0.0, x], [0.0, f, y], [0.0, 0.0, 1.0]])
        return pose_of_plane(matrix, self.ideal_from_plane @ self.first_from[way])

    def centre(self, way: int, focal: float) -> Array:
        """Where the camera stands in the rig then (3,)."""
        centre: Array = self.stage_mm + self.pose(way, focal).inverse().translation
        return centre


def _settled(views: Sequence[StagedNumberings]) -> _Camera | PlateRefusal:
    """Return the camera with the one way round that the stage's moves fit, or why they do not tell."""
    staged = [each for each in views if each.stage_mm is not None and each.is_whole]
    staged = staged[:: math.ceil(len(staged) / _MOST_VIEWS)] if staged else []
    if not staged:
        return _untold("in no view on the stage the whole plate is seen")
    moves = np.array([each.stage_mm for each in staged])
    if float(np.ptp(moves[:, :2], axis=0).max()) < _LEAST_MOVE_MM:
        return _untold("on the stage the plate was not moved along x or y while the whole of it was seen")
    seen = [_Seen.of(each) for each in staged]
    tried: list[tuple[tuple[float, float, Array], list[tuple[_Seen, int]], Array]] = []
    for first in range(len(staged[0].found)):
        direction = staged[0].found.y_axis(first)
        ways = [nearest_turn(each.found, direction) for each in staged]
        told = [(one, way[0]) for one, way in zip(seen, ways, strict=True) if way is not None]
        if len(told) < 2 or np.ptp([one.stage_mm[:2] for one, _ in told], axis=0).max() < _LEAST_MOVE_MM:
            continue
        tried.append((_agreement(told, staged[0].found.size[0]), told, direction))
    tried.sort(key=lambda each: each[0][0])
    if not tried or (len(tried) > 1 and tried[0][0][0] > _CLEARLY * tried[1][0][0]):
        return _untold("the stage's moves fit two ways round about as well")
    (_, focal, centre), ((first_seen, way), *_), direction = tried[0]
    rotation = first_seen.pose(way, focal).rotation
    return _Camera(direction, first_seen.plane, rotation, centre, focal)


def _agreement(told: Sequence[tuple[_Seen, int]], width: int) -> tuple[float, float, Array]:
    """How far apart the views put the camera, RMS, millimetres; with which focal length; where it stands."""

    def centres(log_focal: float) -> Array:
        return np.array([one.centre(way, width * math.exp(log_focal)) for one, way in told])

    def spread(log_focal: float) -> float:
        try:
            found = centres(log_focal)
        except (DegenerateInputError, np.linalg.LinAlgError):
            return math.inf
        return float(np.sqrt(np.square(found - found.mean(axis=0)).sum(axis=1).mean()))

    steps = np.linspace(math.log(_SHORTEST), math.log(_LONGEST), 24)
    best = int(np.argmin([spread(step) for step in steps]))
    low, high = steps[max(best - 1, 0)], steps[min(best + 1, len(steps) - 1)]
    log_focal = float(minimize_scalar(spread, bounds=(low, high), method="bounded").x)
    return spread(log_focal), width * math.exp(log_focal), centres(log_focal).mean(axis=0)


def _untold(why: str) -> PlateRefusal:
    return PlateRefusal(
        PlateRefusalCode.AMBIGUOUS,
        f"the plate looks the same turned, and the stage does not tell which way round it is: {why}. "
        "Add a view with the plate moved along x or y, or say another orientation in the plate file.",
    )
