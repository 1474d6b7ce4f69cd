"""`truewheel calibrate`, from a rendered session to a measured wheel."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sensors.formats import read_calibration, read_image, write_image
from sensors.formats.calibration_input import read_calibration_input
from tests.end_to_end.conftest import Truewheel, simulated

pytestmark = pytest.mark.slow  # All need a rendered session.

KEYS = {
    "outcome",
    "reason",
    "reprojection_rms_px",
    "calibration_id",
    "predicted_camber_u95_deg",
    "predicted_toe_u95_deg",
}
SEED = 5  # of the rendered wheel too, so that the same rig took both


@pytest.fixture(scope="module")
def session() -> Path:
    return simulated(f"plate-session --seed {SEED} --views 4") / "made"


def test_a_wheel_measured_with_a_found_calibration_is_as_with_the_true_one(
    truewheel: Truewheel, session: Path, rendered_wheel: Path, tmp_path: Path
) -> None:
    out, report = tmp_path / "rig.json", tmp_path / "report"
    ended = truewheel("calibrate", session, "--out", out, "--report", report, "--json")
    assert ended.status == 0, ended.err
    result = ended.json
    assert result["report"] == str(report / "report.html")
    page = (report / "report.html").read_text(encoding="utf-8")
    assert result["calibration_id"] in page
    assert page.count('src="data:image/png;base64,') == 5
    assert all(f"<td>{name}</td>" in page for name in ("head_3 right", "tilted_1"))
    assert set(result) >= KEYS
    assert (result["outcome"], result["reason"]) == ("accepted", None)
    assert 0.0 < result["predicted_camber_u95_deg"] < 0.001
    assert read_calibration(out).id == result["calibration_id"]
    assert len(read_calibration_input(tmp_path / "rig.input.json").views) == 4
    true = truewheel(
        "measure", rendered_wheel, "--calibration", rendered_wheel / "calibration.json", "--json"
    ).json
    mine = truewheel("measure", rendered_wheel, "--calibration", out, "--json").json
    for angle in ("camber_deg", "toe_deg"):
        assert abs(mine[angle] - true[angle]) * 60.0 < 0.05
    assert mine["calibration_id"] == result["calibration_id"]


def test_a_refused_calibration_leaves_the_one_in_force(
    truewheel: Truewheel, session: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "session"
    copy.mkdir()
    for file in session.iterdir():
        (copy / file.name).write_bytes(file.read_bytes())
    first = next(
        image
        for view in json.loads((copy / "session.json").read_text())["views"]
        for image in [view["images"][0]["left"]]
    )
    dark = np.zeros_like(read_image(copy / first))
    (copy / first).unlink()
    write_image(copy / first, dark)
    out = tmp_path / "rig.json"
    out.write_text("in force", encoding="utf-8")
    ended = truewheel("calibrate", copy, "--out", out, "--json")
    assert ended.status == 1
    assert set(ended.json) >= KEYS
    assert ended.json["outcome"] == "refused"
    assert "head_1 left" in ended.json["reason"]
    assert ended.json["calibration_id"] is None
    assert out.read_text(encoding="utf-8") == "in force"
    assert list(tmp_path.glob("*.input.json")) == []


def test_a_database_that_fails_leaves_the_calibration_in_force(
    truewheel: Truewheel, session: Path, tmp_path: Path
) -> None:
    out = tmp_path / "rig.json"
    out.write_text("in force", encoding="utf-8")
    lost = f"sqlite:///{tmp_path / 'lost.db'}"
    ended = truewheel("calibrate", session, "--out", out, "--model", "radial", "--database", lost)
    assert ended.status in (2, 3)
    assert "lost.db" in ended.err
    assert "truewheel db migrate" in ended.err
    assert out.read_text(encoding="utf-8") == "in force"
    assert list(tmp_path.glob("*.input.json")) == []


def test_a_session_that_is_not_there_is_bad_input(truewheel: Truewheel, tmp_path: Path) -> None:
    ended = truewheel("calibrate", tmp_path / "none", "--out", tmp_path / "rig.json")
    assert ended.status == 2
    assert "none" in ended.err
    assert not (tmp_path / "rig.json").exists()
