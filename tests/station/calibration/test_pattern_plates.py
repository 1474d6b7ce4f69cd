"""Sessions with plates that people own: numbered by what their views tell together, or refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration import CalibrationInput, cameras_of_rig
from alignment.errors import DegenerateInputError
from alignment.imaging import Orientation, Pattern, PlateRefusalCode
from alignment.values import RigCalibration
from sensors.formats import PlateDescription, PlateSession, PlateTruth
from sensors.simulation.plate_session import PlatePosition, PlateSessionSpec, simulate_plate_session
from station.calibration.calibrate import CalibrateSettings, calibrate_session
from station.calibration.observing import KnownCameras, observe_session
from station.studies.heads import build_head
from station.studies.plates import SPEC, compared_plates, described_plate, misnumbered
from tests.once import once

LOW = PlatePosition("low", (0.0, 0.0, -25.0))
RIGHT = PlatePosition("right", (6.0, 0.0, 10.0))
TILTED = PlatePosition("tilted", tilt=(0.2, 0.1))
SMALL = {
    "columns": (-3, 3), "rows": (-3, 3), "pitch_x_mm": 9.0, "pitch_y_mm": 9.0, "mark_diameter_mm": 5.4,
    "orientation": "stage",
}  # fmt: skip


@once
def head() -> RigCalibration:
    return build_head(SPEC, np.random.default_rng(1))


def taken(plate: PlateDescription, *positions: PlatePosition) -> tuple[PlateSession, PlateTruth]:
    spec = PlateSessionSpec(positions=positions)
    return simulate_plate_session(spec, plate, head(), np.random.default_rng(2))


@once
def circles() -> tuple[PlateSession, PlateTruth]:
    """A grid that looks the same turned by 90°: two positions of the stage, and one tilted."""
    return taken(described_plate("small", "circles", SMALL), LOW, RIGHT, TILTED)


def only(session: PlateSession, *names: str) -> PlateSession:
    return replace(session, views=tuple(view for view in session.views if view.name in names))


def numbered(session: PlateSession, truth: PlateTruth, **known: object) -> tuple[int, int]:
    """Images that were refused, marks that were numbered wrong."""
    views, refusals = observe_session(session, lambda _share, _what: None, **known)  # type: ignore[arg-type]
    data = CalibrationInput(session.plate.plate, views, dict(session.sizes))
    return len(refusals), misnumbered(head(), data, truth)


def test_the_stage_tells_which_way_round_a_symmetrical_grid_lies() -> None:
    session, truth = circles()
    assert numbered(session, truth) == (0, 0)


@pytest.mark.parametrize("names", [("low",), ("low", "tilted"), ("tilted",)])
def test_a_grid_that_nothing_tells_of_is_refused_by_view_and_camera(names: tuple[str, ...]) -> None:
    session = only(circles()[0], *names)
    views, refusals = observe_session(session, lambda _share, _what: None)
    assert len(refusals) == 2 * len(names)
    assert {why.code for _, _, why in refusals} == {PlateRefusalCode.AMBIGUOUS}
    assert all(not view.observations for view in views)
    found = calibrate_session(session, CalibrateSettings(), session.time_utc, lambda _share, _what: None)
    assert found.calibration is None
    assert f"view {names[0]}, head left: the plate looks the same turned" in found.judgement.reason
    assert "Add a view with the plate moved along x or y" in found.judgement.reason


def test_moves_along_z_alone_do_not_tell() -> None:
    session, _ = circles()
    straight = replace(session.views[1], stage_mm=np.array([0.0, 0.0, 10.0]))
    moved = replace(session, views=(session.views[0], straight))
    assert len(observe_session(moved, lambda _share, _what: None)[1]) == 4


def test_views_of_a_part_are_numbered_once_the_stage_is_understood() -> None:
    plate = described_plate("small", "circles", SMALL)
    aside = PlatePosition("aside", (70.0, -5.0, 5.0))
    session, truth = taken(plate, LOW, RIGHT, aside)
    views, refusals = observe_session(session, lambda _share, _what: None)
    assert not refusals
    seen = [len(one.marks) for one in views[2].observations.values()]
    assert min(seen) < 49
    assert numbered(session, truth) == (0, 0)


def test_known_cameras_tell_so_that_one_view_is_enough() -> None:
    """As `truewheel calibration check` and `calibration frame` have them."""
    session, truth = circles()
    assert numbered(only(session, "low"), truth, known=KnownCameras(head(), np.eye(3))) == (0, 0)
    assert numbered(only(session, "tilted"), truth, known=KnownCameras(head(), np.eye(3))) == (0, 0)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert numbered(only(session, "low"), truth, known=KnownCameras(head(), quarter))[1] > 0


def test_an_upright_plate_needs_no_stage() -> None:
    session, truth = circles()
    upright = session.plate.file.model_copy(update={"orientation": "upright"})
    plate = replace(session.plate, file=upright, plate=upright.plate())
    held = tuple(replace(view, stage_mm=None) for view in session.views)
    assert plate.plate.pattern.orientation is Orientation.UPRIGHT
    assert numbered(replace(session, plate=plate, views=held), truth) == (0, 0)


def test_every_kind_is_numbered_right_and_located_as_well_as_our_own() -> None:
    """The long comparison is `truewheel study plates`."""
    errors = {}
    for name, plate in compared_plates().items():
        session, truth = taken(plate, *((LOW, RIGHT) if name.endswith("circles") else (LOW,)))
        views, refusals = observe_session(session, lambda _share, _what: None)
        assert not refusals, name
        data = CalibrationInput(plate.plate, views, dict(session.sizes))
        assert misnumbered(head(), data, truth) == 0
        cameras = cameras_of_rig(head())
        squares = []
        for key, seen in views[0].observations.items():
            assert len(seen.marks) == len(plate.plate.points), name
            points = truth.rig_from_plate["low"].apply(truth.points[seen.marks])
            off = seen.pixels - cameras[key].project(points)
            # Perspective shifts the centres of outlines all alike on a plate that is not tilted.
            squares.append(np.square(off - off.mean(axis=0)).mean())
        errors[name] = float(np.sqrt(np.mean(squares)))
    assert max(errors.values()) < 1.5 * errors["ring_marks"], errors


def test_a_pattern_is_none_of_the_plate_s_radius() -> None:
    plate = compared_plates()["chessboard"].plate
    with pytest.raises(DegenerateInputError, match="0 for corners of squares"):
        replace(plate, mark_radius_mm=1.0)
    with pytest.raises(DegenerateInputError, match="mark_radius_mm"):
        replace(plate, pattern=Pattern())
