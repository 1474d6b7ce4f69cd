import json
from pathlib import Path

import numpy as np
import pytest

from alignment.calibration.observations import cameras_of_rig
from alignment.errors import FormatError
from sensors.formats.calibration_input import read_calibration_input, write_calibration_input
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.simulated_views import STAGES, observe, square_plate


def written(folder: Path) -> Path:
    rig = build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(1))
    data = observe(
        cameras_of_rig(rig), square_plate(), STAGES[:2], np.random.default_rng(1), corrected=False
    ).data
    path = folder / "rig.input.json"
    write_calibration_input(path, data, "id-1")
    again = read_calibration_input(path)
    np.testing.assert_array_equal(again.plate.points, data.plate.points)
    np.testing.assert_array_equal(again.plate.sigma_mm, data.plate.sigma_mm)
    assert again.sizes == data.sizes
    for new, old in zip(again.views, data.views, strict=True):
        assert new.name == old.name
        assert new.stage_mm is not None
        np.testing.assert_array_equal(new.stage_mm, old.stage_mm)
        assert list(new.observations) == list(old.observations)
        for key, seen in old.observations.items():
            found = new.observations[key]
            np.testing.assert_array_equal(found.marks, seen.marks)
            np.testing.assert_array_equal(found.pixels, seen.pixels)
            np.testing.assert_array_equal(found.covariance, seen.covariance)
            assert found.corrected is False
    return path


def test_what_was_written_reads_back_exactly(tmp_path: Path) -> None:
    written(tmp_path)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("stage_sigma_mm", -1.0, "stage_sigma_mm"),
        ("schema", "truewheel.shot/1", "schema"),
        ("views", [], "views"),
        ("extra", 1, "extra"),
    ],
)
def test_a_wrong_field_is_named(tmp_path: Path, field: str, value: object, message: str) -> None:
    path = written(tmp_path)
    content = json.loads(path.read_text(encoding="utf-8"))
    content[field] = value
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(FormatError, match=message):
        read_calibration_input(path)


def test_a_mark_that_the_plate_does_not_have_is_told(tmp_path: Path) -> None:
    path = written(tmp_path)
    content = json.loads(path.read_text(encoding="utf-8"))
    content["views"][0]["seen"][0]["marks"][0] = 99_999
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(FormatError, match="rows 0"):
        read_calibration_input(path)
