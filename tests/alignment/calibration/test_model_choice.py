from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration.model_choice import choose_model
from alignment.calibration.observations import CameraKey, cameras_of_rig
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel, PosedCamera
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.simulated_views import STAGES, SimulatedViews, observe, square_plate


def views_through(model: CameraModel, views: int = 7) -> SimulatedViews:
    """One head whose two cameras have this lens, seen through by an even plate."""
    rig = cameras_of_rig(build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(1)))
    cameras: dict[CameraKey, PosedCamera] = {
        key: replace(camera, model=model) for key, camera in rig.items() if key[0] == "head_1"
    }
    return observe(cameras, square_plate(), STAGES[:views], np.random.default_rng(2))


def lens(kind: str, *coefficients: float) -> CameraModel:
    return CameraModel(1280, 1024, 1500.0, 1500.0, 640.0, 512.0, kind, coefficients)


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        (lens("division", -0.12), {"division"}),
        (lens("brown", -0.2, 0.12, 0.0, 0.0, 0.0), {"radial"}),
        (lens("brown", -0.2, 0.12, 0.001, -0.002, 0.1), {"brown5"}),
        (lens("brown", -0.2, 0.1, 0.0, 0.0, 0.0, 0, 0, 0, 0.003, -0.004, 0.002, 0.003), {"thin_prism"}),
    ],
)
def test_the_simplest_sufficient_model_is_chosen(model: CameraModel, expected: set[str]) -> None:
    choice = choose_model(views_through(model).data)
    assert choice.left_out == "views"
    assert choice.model in expected, choice.scores


def test_marks_are_left_out_where_views_are_few() -> None:
    choice = choose_model(views_through(lens("brown", -0.2, 0.12, 0.001, -0.002, 0.1), views=3).data)
    assert choice.left_out == "marks"
    assert choice.model == "brown5"
    assert [score.terms for score in choice.scores] == sorted(score.terms for score in choice.scores)


def test_the_models_tried_are_reported() -> None:
    tried: list[str] = []
    choose_model(
        views_through(lens("division", -0.12)).data, candidates=("brown5", "division"), progress=tried.append
    )
    assert tried == ["division", "brown5"]


def test_views_that_no_model_fits_are_refused() -> None:
    data = views_through(lens("division", -0.12)).data
    alike = replace(data, views=data.views[:1])
    with pytest.raises(DegenerateInputError, match="head_1 left"):
        choose_model(alike)
