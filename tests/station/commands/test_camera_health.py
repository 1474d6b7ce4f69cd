"""A maintainer asks how the cameras were."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from db.records import CameraFigure
from db.store import ResultStore
from station.cli import main
from station.health.over_time import trends

NOW = int(datetime.now(UTC).timestamp() // 3600)
TODAY = NOW - NOW % 24
CAMERA = "front_left/head_2/right"


def day(ago: int, value: float, figure: str = "line_strength", camera: str = CAMERA) -> CameraFigure:
    return CameraFigure.of(camera, figure, 24, TODAY - 24 * ago, value)


@pytest.fixture
def database(tmp_path: Path) -> str:
    url = f"sqlite:///{tmp_path / 'results.db'}"
    with ResultStore(url, create=True) as store:
        figures = [day(ago, 4.0 - 0.01 * (60 - ago)) for ago in range(60, -1, -1)]
        figures += [CameraFigure.of(CAMERA, "line_strength", 0, start, 9.0 + start) for start in (3, 5)]
        figures += [day(1, 41.0, "temperature_c", "rear_left/head_1/left"), day(200, 99.0)]
        figures += [CameraFigure.of(CAMERA, "failures", 1, TODAY, 1.0)]
        store.add_camera_figures("EOL-1", figures)
    return url


def called(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["camera", "health", *arguments])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def test_trend_of_each_figure_is_shown_with_its_first_shots_and_slope(
    database: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = called(capsys, "--database", database, "--json")
    assert status == 0
    said = json.loads(out)
    assert said["station"] == "EOL-1"
    assert said["figures"] == {"cameras": 2, "trends": 2, "shots": 61}
    light, warmth = said["trends"]
    assert (light["camera"], light["figure"], light["first"]) == (CAMERA, "line_strength", 14.0)
    assert (light["newest"], light["minimum"], light["maximum"]) == pytest.approx((3.4, 3.4, 4.0))
    assert light["per_month"] == pytest.approx(-0.3)
    assert light["days"][-1]["day"] == f"{datetime.fromtimestamp(TODAY * 3600, UTC):%Y-%m-%d}"
    assert (warmth["first"], warmth["per_month"]) == (None, None)
    status, out, _ = called(capsys, "--database", database)
    assert CAMERA in out
    assert "line_strength" in out


def test_period_and_camera_can_be_chosen(database: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("--database", database, "--json", "--camera", "front_left", "--from", "300d")
    [light] = json.loads(called(capsys, *arguments)[1])["trends"]
    assert light["maximum"] == 99.0
    since = (datetime.now(UTC) - timedelta(days=10)).strftime("%Y-%m-%d")
    [light] = json.loads(called(capsys, *arguments[:-1], since)[1])["trends"]
    assert light["shots"] == 11
    status, out, _ = called(capsys, "--database", database, "--camera", "rear_right")
    assert status == 0
    assert "nothing is stored of cameras of EOL-1" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--station", "EOL-2"), "--station"),
        (("--from", "yesterday"), "--from"),
    ],
)
def test_unknown_station_or_time_is_refused(
    database: str, capsys: pytest.CaptureFixture[str], arguments: tuple[str, str], words: str
) -> None:
    status, _, err = called(capsys, "--database", database, *arguments)
    assert status == 2
    assert words in err


def test_station_is_asked_for_where_there_are_two(database: str, capsys: pytest.CaptureFixture[str]) -> None:
    with ResultStore(database) as store:
        store.add_camera_figures("EOL-2", [day(1, 1.0)])
    status, _, err = called(capsys, "--database", database)
    assert status == 2
    assert "EOL-1" in err
    assert "EOL-2" in err
    assert called(capsys, "--database", database, "--station", "EOL-2")[0] == 0


def test_days_with_more_shots_weigh_more() -> None:
    def of(start: int, mean: float, n: int) -> CameraFigure:
        return CameraFigure(CAMERA, "row_px", 24, start, n, mean, mean, mean)

    even = [of(24 * k, 0.1 + 0.001 * k, 100) for k in range(30)]
    [steady] = trends(even)
    [disturbed] = trends([*even, of(24 * 30, 5.0, 1)])
    assert steady.per_month == pytest.approx(0.03)
    [equal] = trends([*even, of(24 * 30, 5.0, 100)])
    assert disturbed.per_month is not None
    assert equal.per_month is not None
    assert disturbed.per_month < 0.1 * equal.per_month


@pytest.fixture
def warm(tmp_path: Path) -> str:
    """A residual that grows by 1 mpx a day and follows the temperature of its camera by 2 mpx each kelvin."""
    url = f"sqlite:///{tmp_path / 'results.db'}"
    rng = np.random.default_rng(7)
    with ResultStore(url, create=True) as store:
        figures = []
        for ago in range(60, -1, -1):
            kelvin = 40.0 + 3.0 * math.sin(ago / 3.0) - 0.05 * ago
            residual = 0.1 + 0.001 * (60 - ago) + 0.002 * (kelvin - 40.0) + 0.001 * rng.standard_normal()
            figures += [day(ago, residual, "row_px"), day(ago, kelvin, "temperature_c")]
        store.add_camera_figures("EOL-1", figures)
    return url


def test_what_follows_temperature_is_told_apart_and_the_limit_s_day_is_forecast(
    warm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = json.loads(called(capsys, "--database", warm, "--json", "--limit", "row_px=0.2")[1])
    [row, warmth] = said["trends"]
    assert row["per_kelvin"] == pytest.approx(0.002, abs=3 * row["per_kelvin_deviation"])
    assert row["drift_per_month"] == pytest.approx(0.03, abs=3 * row["drift_per_month_deviation"])
    # Warming adds to what a line in time alone finds.
    assert row["per_month"] > row["drift_per_month"] + 3 * row["drift_per_month_deviation"]
    # At the mean temperature of 38.5 °C: 0.2 = 0.1 − 0.003 + 0.001 · days, so 103 days after the first.
    due = datetime.fromtimestamp(TODAY * 3600, UTC) + timedelta(days=43)
    early, late = (datetime.fromisoformat(row["reached"][end] + "T00:00Z") for end in ("earliest", "latest"))
    assert early - timedelta(days=2) <= due <= late + timedelta(days=2)
    assert early < late < early + timedelta(days=20)
    assert (warmth["limit"], warmth["reached"], warmth["per_kelvin"]) == (None, None, None)
    out = called(capsys, "--database", warm, "--limit", "row_px=0.2")[1]
    assert "limit reached" in " ".join(out.split())


def test_a_limit_that_nothing_drifts_to_has_no_day(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = f"sqlite:///{tmp_path / 'results.db'}"
    rng = np.random.default_rng(3)
    with ResultStore(url, create=True) as store:
        store.add_camera_figures(
            "EOL-1", [day(ago, 0.1 + 0.01 * rng.standard_normal(), "row_px") for ago in range(60)]
        )
    [row] = json.loads(called(capsys, "--database", url, "--json", "--limit", "row_px=0.2")[1])["trends"]
    assert (row["limit"], row["reached"]) == (0.2, None)


def test_a_new_calibration_is_no_drift() -> None:
    """The step of a residual at a calibration was forecast to go on."""
    rng = np.random.default_rng(5)
    means = [(0.3 if ago > 30 else 0.1) + 0.001 * rng.standard_normal() for ago in range(60, -1, -1)]
    figures = [day(ago, mean, "row_px") for ago, mean in zip(range(60, -1, -1), means, strict=True)]
    [stepped] = trends(figures)
    assert stepped.drift is not None
    made = CameraFigure.of(CAMERA, "row_px", 0, TODAY - 24 * 31 + 9, 0.1)
    [calibrated] = trends([*figures, made])
    assert calibrated.drift is not None
    assert calibrated.drift.n == 31
    assert calibrated.drift.slope == pytest.approx(0.0, abs=4 * calibrated.drift.slope_deviation)
    assert abs(calibrated.drift.slope) < 0.02 * abs(stepped.drift.slope)


@pytest.mark.parametrize("given", ["row_px", "row_px=", "row=0.2", "row_px=nan", "row_px=1e999", "=0.2", ""])
def test_a_limit_that_is_none_is_refused(warm: str, given: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = called(capsys, "--database", warm, "--limit", given)
    assert (status, out) == (2, "")
    assert "--limit" in err
    assert "row_px" in err
