"""Too few points, all in one place, on one line, at one depth: one clear error, never a solver's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from alignment.arrays import Array, Mask
from alignment.calibration.adjustment import adjust
from alignment.calibration.check import check_with_plate
from alignment.calibration.correction import fit_correction
from alignment.calibration.dlt import calibrate_dlt
from alignment.calibration.faugeras import calibrate_faugeras
from alignment.calibration.lenz import calibrate_lenz
from alignment.calibration.observations import CalibrationInput, cameras_of_rig
from alignment.calibration.planar import calibrate_planar
from alignment.calibration.start import start_values
from alignment.calibration.tsai import calibrate_tsai
from alignment.calibration.two_steps import heads_then_poses, rigid_fit
from alignment.calibration.two_system import calibrate_two_system
from alignment.errors import DegenerateInputError
from alignment.geometry.projective import conic_through, fit_homography
from alignment.imaging.plate import MarkObservations
from alignment.imaging.plate_grid import PlateRefusal, PlateRefusalCode, observe_plate
from alignment.wheel.plane import fit_plane
from station.studies.simulated_views import STAGES, observe, square_plate
from tests.alignment.imaging.plates import photograph, plate, view
from tests.station.calibrations import true_rig

SIZE = (1280, 1024)
MODEL = "division"
RNG = np.random.default_rng(3)
POINTS: dict[str, Array] = {
    "none": np.zeros((0, 3)),
    "one": np.ones((1, 3)),
    "two": RNG.normal(size=(2, 3)),
    "in one place": np.ones((50, 3)),
    "on a line": np.outer(np.arange(50.0), [1.0, 2.0, 3.0]) + 1.0,
    "not numbers": np.full((50, 3), np.nan),
    "one of them infinite": np.concatenate([RNG.normal(size=(49, 3)), np.full((1, 3), np.inf)]),
}
SOLVERS: dict[str, Callable[[Array, Array], object]] = {
    "rigid motion": lambda points, pixels: rigid_fit(points, points),
    "homography": lambda points, pixels: fit_homography(points[:, :2], pixels),
    "conic": lambda points, pixels: conic_through(points[:, :2]),
    "direct linear": lambda points, pixels: calibrate_dlt(points, pixels, SIZE),
    "tsai": lambda points, pixels: calibrate_tsai(points, pixels, SIZE),
    "lenz": lambda points, pixels: calibrate_lenz(points, pixels, SIZE),
    "faugeras": lambda points, pixels: calibrate_faugeras(points, pixels, SIZE),
    "two systems": lambda points, pixels: calibrate_two_system(points, pixels, SIZE),
    "planar": lambda points, pixels: calibrate_planar([(points[:, :2], pixels)] * 3, SIZE),
    "plane": lambda points, pixels: fit_plane(
        points, np.arange(float(len(points))), np.array([0.0, 0.0, 1.0])
    ),
}


@pytest.mark.parametrize("points", POINTS)
@pytest.mark.parametrize("solver", SOLVERS)
def test_points_that_tell_nothing_are_refused_by_every_solver(solver: str, points: str) -> None:
    given = POINTS[points]
    pixels = RNG.normal(size=(len(given), 2)) * 100.0 + 500.0
    with pytest.raises(DegenerateInputError):
        SOLVERS[solver](given, pixels)


@pytest.mark.parametrize("solver", ["direct linear", "tsai", "lenz", "faugeras", "two systems"])
def test_points_at_one_depth_give_a_camera_or_a_refusal(solver: str) -> None:
    flat = np.column_stack([RNG.normal(size=(60, 2)) * 100.0, np.full(60, 900.0)])
    pixels = RNG.normal(size=(60, 2)) * 100.0 + 500.0
    try:
        found = SOLVERS[solver](flat, pixels)
    except DegenerateInputError:
        return
    assert np.isfinite(found.camera.model.parameters).all()  # type: ignore[attr-defined]


def test_a_correction_of_points_in_one_place_is_refused() -> None:
    for name in ("none", "one", "not numbers"):
        with pytest.raises(DegenerateInputError):
            fit_correction(POINTS[name], POINTS[name])


KEPT: dict[str, Callable[[Array], Mask]] = {
    "row": lambda at: at[:, 1] == at[0, 1],
    "column": lambda at: at[:, 0] == at[0, 0],
    "diagonal": lambda at: at[:, 0] == at[:, 1],
    "one": lambda at: np.arange(len(at)) < 1,
    "three": lambda at: np.arange(len(at)) < 3,
    "none": lambda at: np.zeros(len(at), dtype=np.bool_),
}


@pytest.fixture(scope="module")
def seen() -> CalibrationInput:
    return observe(cameras_of_rig(true_rig()), square_plate(), STAGES, np.random.default_rng(2)).data


def thinned(data: CalibrationInput, kept: str, cameras: int, views: int) -> CalibrationInput:
    """Only some marks in the first images."""

    def some(at: MarkObservations) -> MarkObservations:
        rows = np.flatnonzero(KEPT[kept](data.plate.indices[at.marks]))
        return MarkObservations(at.marks[rows], at.pixels[rows], at.covariance[rows], at.corrected)

    return replace(
        data,
        views=tuple(
            replace(
                each,
                observations={
                    key: some(at) if camera < cameras and number < views else at
                    for camera, (key, at) in enumerate(each.observations.items())
                },
            )
            for number, each in enumerate(data.views)
        ),
    )


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kept", KEPT)
@pytest.mark.parametrize(("cameras", "views"), [(1, 1), (9, 1), (1, 99), (9, 99)])
def test_images_that_show_a_row_or_less_end_in_a_result_or_one_error(
    seen: CalibrationInput, kept: str, cameras: int, views: int
) -> None:
    data = thinned(seen, kept, cameras, views)
    entries: tuple[Callable[[], object], ...] = (
        lambda: start_values(data, MODEL),
        lambda: check_with_plate(data, true_rig()),
        lambda: adjust(data).covariance,
        lambda: heads_then_poses(data),
    )
    for entry in entries:
        try:
            found = entry()
        except DegenerateInputError:
            continue
        if isinstance(found, np.ndarray):
            assert np.isfinite(found).all()


@pytest.mark.parametrize("tilt", [0.0, 30.0])
@pytest.mark.parametrize("column", [False, True])
def test_one_row_of_marks_is_named(tilt: float, column: bool) -> None:
    """One such image ended `calibrate` in a singular matrix; another was taken for a view of the plate."""
    rows = {(i, j) for i in range(11) for j in range(9) if (i == 5 if column else j == 4)}
    without = tuple((i, j) for i in range(11) for j in range(9) if (i, j) not in rows)
    image = photograph(plate(), view(distance=380.0, tilt=tilt), without=without)
    for corrected in (True, False):
        found = observe_plate(image, plate(), corrected=corrected)
        assert isinstance(found, PlateRefusal)
        assert found.code is PlateRefusalCode.ONE_ROW
