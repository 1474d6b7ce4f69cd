"""What a person reads on a certificate: every figure against the record, from the text of the PDF."""

from __future__ import annotations

import math
from datetime import datetime, timedelta, timezone
from pathlib import Path
from uuid import UUID

import pytest
from pypdf import PdfReader

from db.exports.certificate import tolerance_picture, write_vehicle_certificate
from db.exports.rows import AngleRow, angle_rows
from db.queries import VinHistory
from db.records import (
    CheckOutcome,
    CycleOutcome,
    EventRecord,
    Severity,
    StoredCycle,
    StoredZero,
    Verdict,
    WheelKind,
)
from tests.db.example_records import (
    ANGLES,
    CALIBRATION,
    NOON,
    axle,
    check,
    cycle,
    geometry,
    refused_wheel,
    wheel,
    zero,
)

BERLIN = timezone(timedelta(hours=1))
CREATED = datetime(2026, 11, 23, 0, 30, tzinfo=BERLIN)
RECEIVED = datetime(2026, 11, 22, 0, 15, 7, tzinfo=BERLIN)


def rad(degrees: float) -> float:
    return math.radians(degrees)


def history(**changes: object) -> VinHistory:
    """Limits that are not symmetric, k that is not 2, times that are not UTC, every angle different."""
    wheels = (
        wheel(
            "front_left", camber=rad(-0.51237), camber_u=rad(0.01234), camber_low=rad(-1.125),
            camber_high=rad(0.25), toe=rad(0.123456), toe_u=rad(0.00456), toe_low=rad(-0.0625),
            toe_high=rad(0.375), coverage_factor=3.0,
        ),
        wheel(
            "front_right", toe=rad(0.5), verdict=Verdict.NOK, coverage_factor=3.0,
            zero_measurement_id="zero-1",
        ),
    )  # fmt: skip
    front = axle(
        "front", total_toe=rad(0.6543), total_toe_u=rad(0.002), total_toe_low=rad(-0.5),
        total_toe_high=rad(0.75), verdict=Verdict.OK, guard_band=True, coverage_factor=3.0,
    )  # fmt: skip
    values: dict[str, object] = {
        "uuid": UUID(int=7), "received_utc": RECEIVED, "measured_utc": RECEIVED + timedelta(seconds=3),
        "outcome": CycleOutcome.NOK, "wheels": wheels, "axles": (front,), "vehicle_angles": ANGLES,
    }  # fmt: skip
    record = cycle(**(values | changes))  # type: ignore[arg-type]
    events = (EventRecord(RECEIVED, "EOL-1", Severity.WARNING, "climate", "warm", "38 °C"),)
    checks = (
        check(
            utc=datetime(2026, 11, 20, 0, 5, tzinfo=BERLIN), outcome=CheckOutcome.OUT, reason="camera 2 moved"
        ),
        check("another-calibration"),
    )
    measured = zero(
        measured_utc=datetime(2026, 11, 19, 0, 45, tzinfo=BERLIN), camber=rad(0.03),
        certified_camber=rad(0.01), toe=rad(-0.05), certified_toe=rad(0.02),
    )  # fmt: skip
    return VinHistory(
        "TRUEWHEEL00000001",
        (StoredCycle(record, RECEIVED + timedelta(seconds=5)),),
        {CALIBRATION.id: CALIBRATION},
        checks,
        {"zero-1": StoredZero(measured, None, NOON)},
        (),
        events,
        (),
    )


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return read(tmp_path_factory.mktemp("certificate") / "c.pdf", history())


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The same in the order of writing, where a cell of several lines is one."""
    path = tmp_path_factory.mktemp("certificate") / "c.pdf"
    write_vehicle_certificate(path, history(), created=CREATED)
    return " ".join(" ".join(page.extract_text() for page in PdfReader(path).pages).split())


def read(path: Path, found: VinHistory) -> list[str]:
    write_vehicle_certificate(path, found, created=CREATED, source="sqlite:///r.db")
    pages = [page.extract_text(extraction_mode="layout") for page in PdfReader(path).pages]
    return [" ".join(line.split()) for page in pages for line in page.splitlines()]


@pytest.mark.parametrize(
    "expected",
    [
        # Value, expanded uncertainty (k 3), lower limit, upper limit, verdict: in this order.
        "front left camber \u22120.5124 ± 0.0370 \u22121.1250 0.2500 ok",
        "front left toe +0.1235 ± 0.0137 \u22120.0625 0.3750 ok",
        "front right toe +0.5000 ± 0.0017 \u22120.2000 0.2000 nok",
        "front total toe +0.6543 ± 0.0060 \u22120.5000 0.7500 ok",
        "front camber difference +0.0000 ± 0.0024 without limits",
        "vehicle thrust angle (left positive) +0.0057 ± 0.0008 without limits",
        "vehicle front toe left to thrust line +0.1146 without limits",
        "front right toe above the limit 0.2000° by 0.3000°",
    ],
)
def test_angle_stands_with_expanded_uncertainty_limits_and_verdict(lines: list[str], expected: str) -> None:
    assert expected in lines


@pytest.mark.parametrize(
    "expected",
    [
        "Vehicle TRUEWHEEL00000001, compact",
        "Result NOT OK",
        "Station EOL-1",
        # An hour before midnight in UTC, whatever zone the times came in.
        "Triggered, stored 2026-11-21 23:15:07 UTC, 2026-11-21 23:15:12 UTC",
        "Software, configuration 0.1.0, sha256:00",
        "2026-11-21 23:15:07 UTC warning warm 38 °C",
        "2026-11-19 23:05:00 UTC cal-2026-11 plate session out: camera 2 moved",
        # Measured less certified.
        "2026-11-18 23:45:00 UTC front_left M-17 +0.0200°, \u22120.0700°",
    ],
)
def test_facts_and_times_in_utc_stand_as_recorded(whole: str, expected: str) -> None:
    assert expected in whole


def test_only_checks_of_its_own_calibrations_stand_on_it(lines: list[str]) -> None:
    assert not [line for line in lines if "another-calibration" in line]


def test_footer_names_cycle_and_time_of_making(lines: list[str]) -> None:
    assert f"cycle {UUID(int=7)} made 2026-11-22 23:30:00 UTC 1 of 1" in lines


@pytest.mark.parametrize(
    ("outcome", "said"),
    [
        (CycleOutcome.FAULT, "Result NO VERDICT: station fault: head 2 dark"),
        (CycleOutcome.ABORTED, "Result NO VERDICT: aborted: head 2 dark"),
    ],
)
def test_vehicle_without_verdict_is_neither_ok_nor_not_ok(
    tmp_path: Path, outcome: CycleOutcome, said: str
) -> None:
    found = history(
        outcome=outcome, reason_code="x", reason_text="head 2 dark", wheels=(refused_wheel("front_left"),),
        axles=(), vehicle_angles=None,
    )  # fmt: skip
    lines = read(tmp_path / "c.pdf", found)
    assert said in lines
    assert "front left camber – not measured" in lines
    assert "front left camber head 2 sees no light: clean its window" in lines


def test_certificate_of_a_type_without_guard_band_does_not_claim_one(
    tmp_path: Path, lines: list[str]
) -> None:
    assert any("ISO 14253-1" in line for line in lines)
    loose = history(
        wheels=(wheel("front_left", guard_band=False),),
        axles=(),
        outcome=CycleOutcome.OK,
        vehicle_angles=None,
    )
    found = read(tmp_path / "c.pdf", loose)
    assert not any("ISO 14253-1" in line for line in found)
    assert "Result OK" in found


def rows_of(found: VinHistory) -> list[AngleRow]:
    return list(angle_rows(found.cycles[0]))


def test_picture_places_each_angle_between_its_own_limits() -> None:
    figure = tolerance_picture(rows_of(history()))
    ax = figure.axes[0]
    places = {}
    for line, label in zip(ax.containers, ax.get_yticklabels(), strict=True):
        (x,), (y,) = line.lines[0].get_data()
        places[label.get_text()] = (float(x), float(y), line.lines[0].get_color())
    # (-0.51237 - middle) / half, middle -0.4375, half 0.6875.
    assert places["front left camber"][0] == pytest.approx((-0.51237 + 0.4375) / 0.6875)
    assert places["front left toe"][0] == pytest.approx((0.123456 - 0.15625) / 0.21875)
    # Far outside is drawn at the edge, and in another colour.
    assert places["front right toe"][0] == pytest.approx(2.2)
    assert places["front right toe"][2] != places["front left toe"][2]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["lower limit", "middle", "upper limit"]
    bar = ax.containers[0].lines[2][0].get_segments()[0]
    assert (bar[1][0] - bar[0][0]) / 2 == pytest.approx(3 * 0.01234 / 0.6875)


@pytest.mark.parametrize("degraded", [True, False, None])
def test_certificate_says_that_a_head_was_lost(tmp_path: Path, degraded: bool | None) -> None:
    """It stood at the end of the method's name alone."""
    one = history(
        wheels=(wheel("front_left", degraded=degraded),),
        axles=(),
        outcome=CycleOutcome.OK,
        vehicle_angles=None,
    )
    write_vehicle_certificate(tmp_path / "c.pdf", one, created=CREATED)
    text = " ".join(" ".join(page.extract_text() for page in PdfReader(tmp_path / "c.pdf").pages).split())
    assert ("a head was lost" in text) is (degraded is True)


def test_lengths_and_run_outs_stand_in_millimetres_with_verdicts_of_their_own(tmp_path: Path) -> None:
    turned = wheel("front_left", kind=WheelKind.SPIN_AXIS, run_out=0.75, run_out_u=0.01, run_out_high=1.0)
    found = history(
        wheels=(turned, wheel("front_right", load_mm=0.314)), outcome=CycleOutcome.NOK,
        geometry=geometry(
            verdict=Verdict.NOK, coverage_factor=3.0, setback_front_low=-0.5, setback_front_high=0.5
        ),
    )  # fmt: skip
    path = tmp_path / "c.pdf"
    lines = read(path, found)
    for expected in (
        "front left run-out +0.750 ± 0.020 1.000 ok",
        "vehicle track front +1512.500 ± 0.188 1510.000 1515.000 ok",
        "vehicle setback front \u22121.000 ± 0.188 \u22120.500 0.500 nok",
        "vehicle wheelbase left +2701.250 ± 0.188 without limits",
        "vehicle yaw on the stand +0.1000 ± 0.0003 \u22120.5730 0.5730 ok",
        "vehicle setback front below the limit -0.500 mm by 0.500 mm",
    ):
        assert expected in lines, expected
    text = " ".join(" ".join(page.extract_text() for page in PdfReader(path).pages).split())
    assert "against the vehicle's own centreline" in text
    assert "between contact centres" in text
    assert "a load of 0.31 mm was taken off" in text
