"""From measured wheels to verdicts, followed to the record and to the frames on the bus."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta
from typing import Any

import numpy as np
import pytest

from alignment.values import WheelMeasurement
from db.records import CycleOutcome, CycleRecord, VehicleRecord, Verdict, WheelOutcome
from station.configuration.vehicle_types import VehicleType
from station.cycle.answering.answers import Standing, answers_of
from station.cycle.answering.contradiction import as_told, contradicts
from station.cycle.judging.evaluation import Evaluation, evaluate
from station.cycle.judging.verdict import Status
from station.cycle.ports import Identity
from station.cycle.recording.record import cycle_record
from station.cycle.under_way import CycleUnderWay, Trouble
from station.cycle.wheels.positions import WheelResult
from station.cycle.words.cycle import ErrorCode, Mode, Outcome, Quality, Trigger
from station.cycle.words.failure import Failure, fault
from station.line.wire.dbc import LineDatabase, Value, load_line_database
from station.line.wire.results import result_frames
from tests.db.example_records import adjusting, geometry, steering, steering_axis
from tests.station.bench import AXLE, KIND, TODAY, TOLERANCE, VIN, WHEELS, measurement
from tests.station.line.line_bench import DBC

U = 1e-5
LIMIT = math.radians(0.5)


@pytest.fixture(scope="module")
def database() -> LineDatabase:
    return load_line_database(DBC)


def result(wheel: str, found: WheelMeasurement | None, **changes: Any) -> WheelResult:
    values: dict[str, Any] = {"calibration_valid": True, "failure": None, "measured_utc": TODAY}
    return WheelResult(wheel=wheel, calibration_id=f"cal-{wheel}", measurement=found, **(values | changes))


def judged(kind: VehicleType, found: dict[str, WheelMeasurement | None], k: float = 2.0) -> Evaluation:
    return evaluate(kind, [result(wheel, one) for wheel, one in found.items()], k)


def recorded(kind: VehicleType, evaluation: Evaluation) -> CycleRecord:
    trigger = Trigger(7, tuple(w.result.wheel for w in evaluation.wheels), 1, VIN, 100.0, Mode.AUTOMATIC)
    identity = Identity("station_1", "1.0", "abc")
    cycle = CycleUnderWay(trigger, TODAY, (), kind, measured_s=101.0)
    return cycle_record(identity, cycle, evaluation)[0]


def on_the_bus(
    database: LineDatabase, record: CycleRecord, wheels: Sequence[str] = WHEELS
) -> dict[str, list[dict[str, Value]]]:
    answers = answers_of(record, Standing.COMMITTED)
    assert answers.vehicle is not None
    _, frames = result_frames(database, 7, wheels, answers.wheels, answers.axles, answers.vehicle)
    found: dict[str, list[dict[str, Value]]] = {}
    for frame in frames:
        name = database.name_of(frame)
        assert name is not None
        found.setdefault(name, []).append(database.decode(frame))
    return found


@pytest.mark.parametrize("k", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("part", ["camber", "toe"])
@pytest.mark.parametrize("end", [-1.0, 1.0])
def test_guard_band_of_a_wheel_is_k_standard_uncertainties(k: float, part: str, end: float) -> None:
    for short, verdict in ((k + 0.05, Verdict.OK), (k - 0.05, Verdict.NOK)):
        evaluation = judged(KIND, {"front_left": measurement(**{part: end * (LIMIT - short * U)}, u=U)}, k)
        (wheel,) = recorded(KIND, evaluation).wheels
        assert wheel.verdict is verdict
        assert (wheel.coverage_factor, wheel.guard_band) == (k, True)
        assert (wheel.camber_u, wheel.toe_u) == (U, U)


@pytest.mark.parametrize("k", [1.0, 2.0, 3.0])
def test_guard_band_of_an_axle_and_of_the_vehicle_is_k_of_their_own_uncertainty(k: float) -> None:
    wide = KIND.model_copy(
        update={
            "axles": {
                axle: KIND.axles[axle].model_copy(
                    update={
                        name: KIND.axles[axle].camber.model_copy(update={"tolerance_deg": 5.0})
                        for name in ("camber", "toe")
                    }
                )
                for axle in ("front", "rear")
            }
        }
    )
    axle_u, thrust_u = U * math.sqrt(2), U / math.sqrt(2)
    for short, good in ((k + 0.05, True), (k - 0.05, False)):
        toe = (LIMIT - short * axle_u) / 2
        front = {w: measurement(toe=toe, camber=0.0, u=U) for w in WHEELS[:2]}
        assert [axle.total_toe.status for axle in judged(wide, front, k).axles] == [
            Status.OK if good else Status.NOK
        ]
        camber = {"front_left": measurement(camber=2 * toe, toe=0.0, u=U),
                  "front_right": measurement(camber=0.0, toe=0.0, u=U)}  # fmt: skip
        (axle,) = judged(wide, camber, k).axles
        assert axle.camber_difference.status is (Status.OK if good else Status.NOK)
        thrust = LIMIT - short * thrust_u
        whole = dict.fromkeys(WHEELS, measurement(camber=0.0, toe=0.0, u=U)) | {
            "rear_left": measurement(camber=0.0, toe=-thrust, u=U),
            "rear_right": measurement(camber=0.0, toe=thrust, u=U),
        }
        evaluation = judged(wide, whole, k)
        assert evaluation.vehicle is not None
        assert evaluation.vehicle.thrust_angle.status is (Status.OK if good else Status.NOK)
        record = recorded(wide, evaluation)
        assert record.vehicle_angles is not None
        assert record.vehicle_angles.coverage_factor == k
        assert {a.coverage_factor for a in record.axles} == {k}
        assert record.outcome is (CycleOutcome.OK if good else CycleOutcome.NOK)


@pytest.mark.parametrize("part", ["camber", "toe"])
def test_each_angle_is_judged_with_its_own_uncertainty(part: str) -> None:
    covariance = np.diag([U**2, (30 * U) ** 2] if part == "camber" else [(30 * U) ** 2, U**2])
    found = replace(measurement(**{part: LIMIT - 3 * U}), angle_covariance=covariance)
    (wheel,) = judged(KIND, {"front_left": found}).wheels
    assert (wheel.camber.status, wheel.toe.status) == (Status.OK, Status.OK)


def test_without_a_guard_band_the_limits_are_the_limits() -> None:
    bare = KIND.model_copy(update={"guard_band": False})
    for toe, verdict in ((LIMIT - 0.1 * U, Verdict.OK), (LIMIT + 0.1 * U, Verdict.NOK)):
        record = recorded(bare, judged(bare, {"front_left": measurement(toe=toe, u=U)}))
        assert record.wheels[0].verdict is verdict
        assert record.wheels[0].guard_band is False


def test_expanded_uncertainty_reaches_the_bus(database: LineDatabase) -> None:
    found = dict.fromkeys(WHEELS, measurement(u=1e-4))
    for k in (1.0, 3.0):
        sent = on_the_bus(database, recorded(KIND, judged(KIND, found, k)))
        (left, *_) = (values for name, all_ in sent.items() if "Uncertainty" in name for values in all_)
        u95 = next(float(value) for name, value in left.items() if "U95" in name)
        assert u95 == pytest.approx(math.degrees(k * 1e-4), rel=0.05)


@pytest.mark.parametrize("sign", ["left_positive", "right_positive"])
def test_thrust_sign_of_the_vehicle_type_decides_record_and_bus(database: LineDatabase, sign: Any) -> None:
    """A rear axle that rolls to the left: its right wheel points in by 0.2°, its left one out by 0.2°."""
    angle = math.radians(0.2)
    kind = KIND.model_copy(update={"thrust_sign": sign})
    found = {
        "front_left": measurement(toe=0.0),
        "front_right": measurement(toe=0.0),
        "rear_left": measurement(toe=-angle),
        "rear_right": measurement(toe=angle),
    }
    record = recorded(kind, judged(kind, found))
    angles = record.vehicle_angles
    assert angles is not None
    expected = angle if sign == "left_positive" else -angle
    assert (angles.thrust_sign, angles.thrust_angle) == (sign, pytest.approx(expected))
    assert angles.front_toe_left_to_thrust == pytest.approx(angle)
    assert angles.front_toe_right_to_thrust == pytest.approx(-angle)
    (vehicle,) = on_the_bus(database, record)["VehicleResult"]
    assert vehicle["ThrustSign"] == sign
    assert float(vehicle["ThrustAngle"]) == pytest.approx(math.degrees(expected), abs=2e-3)


@pytest.mark.parametrize("sign", ["left_positive", "right_positive"])
def test_limits_of_the_thrust_angle_are_in_its_own_sign(sign: Any) -> None:
    angle = math.radians(0.2)
    left_only = KIND.axles["front"].camber.model_validate({"lower_deg": 0.1, "upper_deg": 0.3})
    kind = KIND.model_copy(update={"thrust_sign": sign, "thrust_angle": left_only})
    found = dict.fromkeys(WHEELS, measurement(toe=0.0)) | {
        "rear_left": measurement(toe=-angle),
        "rear_right": measurement(toe=angle),
    }
    record = recorded(kind, judged(kind, found))
    assert record.vehicle_angles is not None
    assert record.vehicle_angles.verdict is (Verdict.OK if sign == "left_positive" else Verdict.NOK)
    assert record.vehicle_angles.thrust_angle_low == pytest.approx(math.radians(0.1))
    assert record.vehicle_angles.thrust_angle_high == pytest.approx(math.radians(0.3))


def test_every_angle_has_its_own_value_and_its_own_limits(database: LineDatabase) -> None:
    """Sixteen different numbers: none may come in another's place."""
    degrees = {"camber": 0.1, "toe": 0.2, "total_toe": 0.3, "camber_difference": 0.4}

    def tolerances(base: float) -> dict[str, Any]:
        return {name: {"lower_deg": base - d, "upper_deg": base + 2 * d} for name, d in degrees.items()}

    kind = VehicleType.model_validate(
        {"number": 1, "name": "Car", "guard_band": False, "thrust_angle": TOLERANCE,
         "axles": {"front": tolerances(0.0), "rear": tolerances(0.05)}}
    )  # fmt: skip
    found = {
        wheel: measurement(
            camber=math.radians(0.01 * (n + 1)), toe=math.radians(0.05 + 0.013 * n), u=U * (n + 1)
        )
        for n, wheel in enumerate(WHEELS)
    }
    record = recorded(kind, judged(kind, found))
    for n, (name, wheel) in enumerate(zip(WHEELS, record.wheels, strict=True)):
        base = 0.0 if "front" in name else 0.05
        assert (wheel.wheel, wheel.calibration_id) == (name, f"cal-{name}")
        assert wheel.camber == pytest.approx(math.radians(0.01 * (n + 1)))
        assert wheel.toe == pytest.approx(math.radians(0.05 + 0.013 * n))
        assert wheel.camber_u == wheel.toe_u == pytest.approx(U * (n + 1))
        limits = wheel.camber_low, wheel.camber_high, wheel.toe_low, wheel.toe_high
        assert limits == pytest.approx([math.radians(base + x) for x in (-0.1, 0.2, -0.2, 0.4)])
    for axle, base, first in zip(record.axles, (0.0, 0.05), (0, 2), strict=True):
        limits = (axle.total_toe_low, axle.total_toe_high,
                  axle.camber_difference_low, axle.camber_difference_high)  # fmt: skip
        assert limits == pytest.approx([math.radians(base + x) for x in (-0.3, 0.6, -0.4, 0.8)])
        assert axle.total_toe == pytest.approx(math.radians(0.1 + 0.013 * (2 * first + 1)))
        assert axle.camber_difference == pytest.approx(math.radians(-0.01))
        assert axle.guard_band is False
    vehicle = on_the_bus(database, record)["VehicleResult"][0]
    assert float(vehicle["ThrustAngle"]) == pytest.approx(0.0065, abs=2e-3)


@pytest.mark.parametrize("missing", WHEELS)
def test_wheel_without_a_measurement_leaves_its_axle_and_the_vehicle_unset(missing: str) -> None:
    found: dict[str, WheelMeasurement | None] = dict.fromkeys(WHEELS, measurement())
    found[missing] = None
    evaluation = judged(KIND, found)
    for axle in evaluation.axles:
        unset = axle.name == missing.rpartition("_")[0]
        assert {angle.status for angle in axle.angles} == {Status.UNSET if unset else Status.OK}
    assert evaluation.vehicle is not None
    assert evaluation.vehicle.thrust_angle.status is Status.UNSET


@pytest.mark.parametrize("bad", WHEELS)
def test_wheel_without_a_valid_calibration_spoils_what_rests_on_it_and_no_more(bad: str) -> None:
    results = [result(wheel, measurement(), calibration_valid=wheel != bad) for wheel in WHEELS]
    evaluation = evaluate(KIND, results, 2.0)
    assert {w.result.wheel for w in evaluation.wheels if w.toe.status is Status.INVALID} == {bad}
    spoilt = {axle.name for axle in evaluation.axles if axle.total_toe.status is Status.INVALID}
    assert spoilt == {bad.rpartition("_")[0]}
    assert evaluation.vehicle is not None
    assert evaluation.vehicle.thrust_angle.status is Status.INVALID


@pytest.mark.parametrize(
    ("wheels", "axles", "whole"),
    [
        (WHEELS, ["front", "rear"], True),
        (WHEELS[:2], ["front"], False),
        (("front_left", "rear_left", "rear_right"), ["rear"], False),
        (("front_left", "rear_right"), [], False),
    ],
)
def test_axles_and_vehicle_are_judged_only_where_all_their_wheels_were_asked_for(
    wheels: tuple[str, ...], axles: list[str], whole: bool
) -> None:
    evaluation = judged(KIND, dict.fromkeys(wheels, measurement()))
    assert [axle.name for axle in evaluation.axles] == axles
    assert (evaluation.vehicle is not None) is whole
    answers = answers_of(recorded(KIND, evaluation), Standing.COMMITTED)
    assert [axle.axle for axle in answers.axles] == axles
    # Wheels that are no vehicle still say what their toes refer to.
    assert answers.vehicle is not None
    assert answers.vehicle.outcome.judged is whole
    assert answers.vehicle.geometry.reference == "stand"


def test_angle_without_limits_is_reported_and_not_requested(database: LineDatabase) -> None:
    bare = {name: AXLE[name] for name in ("camber", "toe")}
    kind = VehicleType.model_validate({"number": 1, "name": "Car", "axles": {"front": bare, "rear": bare}})
    record = recorded(kind, judged(kind, dict.fromkeys(WHEELS, measurement())))
    assert record.outcome is CycleOutcome.OK
    assert {axle.verdict for axle in record.axles} == {Verdict.NONE}
    answers = answers_of(record, Standing.COMMITTED)
    assert {axle.outcome for axle in answers.axles} == {Outcome.NOT_REQUESTED}
    assert answers.vehicle is not None
    assert answers.vehicle.outcome is Outcome.NOT_REQUESTED


REFUSED = Failure(WheelOutcome.REFUSED, ErrorCode.MEASUREMENT_REFUSED, "head_dark", "front_left: dark")
BROKEN = fault(ErrorCode.CAMERA_FAULT, "rear_right: it burns")


def test_part_that_failed_says_more_than_a_wheel_that_was_refused() -> None:
    failures = {"front_left": REFUSED, "rear_right": BROKEN}
    results = [
        result(wheel, None, failure=failures[wheel]) if wheel in failures else result(wheel, measurement())
        for wheel in WHEELS
    ]
    trigger = Trigger(7, WHEELS, 1, VIN, 100.0, Mode.AUTOMATIC)
    cycle = CycleUnderWay(trigger, TODAY, (), KIND, measured_s=101.0)
    record, trouble = cycle_record(Identity("s", "1", "c"), cycle, evaluate(KIND, results, 2.0))
    assert trouble == Trouble(ErrorCode.CAMERA_FAULT, "rear_right")
    assert record.uuid == cycle.uuid
    assert record.outcome is CycleOutcome.FAULT
    assert record.reason_code == "camera_fault"
    assert record.reason_text == "rear_right: it burns; front_left: dark"
    assert {w.wheel: w.reason_code for w in record.wheels if w.reason_code} == {
        "front_left": "head_dark",
        "rear_right": "camera_fault",
    }


def test_quality_of_a_wheel_that_lost_a_head_is_degraded_on_the_bus() -> None:
    found = dict.fromkeys(WHEELS, measurement()) | {"rear_left": replace(measurement(), degraded=True)}
    record = recorded(KIND, judged(KIND, found))
    # Whatever the method is called.
    named = replace(record, wheels=tuple(replace(wheel, method="x/degraded") for wheel in record.wheels))
    for one in (record, named):
        answers = answers_of(one, Standing.COMMITTED)
        assert {a.wheel: a.quality for a in answers.wheels if a.quality is not Quality.FULL} == {
            "rear_left": Quality.DEGRADED
        }
    assert {wheel.wheel: wheel.degraded for wheel in record.wheels} == {
        wheel: wheel == "rear_left" for wheel in WHEELS
    }
    assert {wheel.method for wheel in record.wheels} == {"tyre_plane/revolution"}


@pytest.mark.parametrize("standing", list(Standing))
def test_nothing_but_what_is_committed_is_told_with_values(standing: Standing) -> None:
    record = recorded(KIND, judged(KIND, dict.fromkeys(WHEELS, measurement())))
    answers = answers_of(record, standing)
    parts = (*answers.wheels, *answers.axles, answers.vehicle)
    told = {Standing.COMMITTED: Outcome.OK, Standing.ABORTED: Outcome.ABORTED}.get(standing, Outcome.FAULT)
    assert {part.outcome for part in parts if part is not None} == {told}
    valued = standing is Standing.COMMITTED
    assert all((wheel.camber_deg is not None) is valued for wheel in answers.wheels)
    assert contradicts(record, standing) is not valued


def test_everything_that_explains_a_wheel_is_recorded() -> None:
    times = {wheel: TODAY + timedelta(seconds=n) for n, wheel in enumerate(("rear_left", "front_left"))}
    results = [
        result(
            wheel,
            replace(measurement(), points_used=np.int64(4321), residual_rms_mm=np.float64(0.0123)),
            measured_utc=utc,
            device_time_s=77.5,
            duration_s=0.25,
            zero_id=f"zero-{wheel}",
        )
        for wheel, utc in times.items()
    ]
    evaluation = evaluate(KIND, results, 2.0)
    record = recorded(KIND, evaluation)
    for wheel in record.wheels:
        assert (wheel.measured_utc, wheel.device_time_s) == (times[wheel.wheel], 77.5)
        assert (wheel.zero_measurement_id, wheel.duration_s) == (f"zero-{wheel.wheel}", 0.25)
        assert (wheel.points_used, wheel.residual_rms_mm) == (4321, 0.0123)
        assert wheel.method == "tyre_plane/revolution"
    # When the last images were taken, whichever rig took them, and when the last wheel was done.
    assert record.measured_utc == times["front_left"]
    assert (record.received_monotonic_s, record.measured_monotonic_s) == (100.0, 101.0)
    assert (record.received_utc, record.trigger_sequence) == (TODAY, 7)
    assert record.vehicle == VehicleRecord(VIN, "Car")
    answers = answers_of(record, Standing.COMMITTED)
    assert {answer.residual_mm for answer in answers.wheels} == {0.0123}


def test_cycle_in_which_nothing_was_measured_has_no_time_of_measuring() -> None:
    record = recorded(
        KIND, evaluate(KIND, [result("front_left", None, measured_utc=None, failure=BROKEN)], 2.0)
    )
    assert (record.measured_utc, record.measured_monotonic_s) == (None, None)


@pytest.mark.parametrize("toe", [0.001, 0.1])
def test_one_wheel_with_a_verdict_contradicts_a_fault_that_was_told_of_all(toe: float) -> None:
    results = [result("front_left", measurement(toe=toe)), result("front_right", None, failure=REFUSED)]
    record = recorded(KIND, evaluate(KIND, results, 2.0))
    assert record.outcome is CycleOutcome.FAULT
    assert contradicts(record, Standing.NOT_COMMITTED)
    failed = [result(wheel, None, failure=REFUSED) for wheel in WHEELS]
    assert not contradicts(recorded(KIND, evaluate(KIND, failed, 2.0)), Standing.NOT_COMMITTED)


def test_a_record_of_what_was_told_has_nothing_that_was_measured_or_turned() -> None:
    """Geometry, steering and its axes stayed in it, with their verdicts, beside a fault of every wheel."""
    record = replace(
        recorded(KIND, evaluate(KIND, [result("front_left", measurement())], 2.0)),
        geometry=geometry(),
        steering=steering(),
        steering_axes=(steering_axis(),),
        adjustings=(adjusting(),),
    )
    for standing in (Standing.NOT_COMMITTED, Standing.ABORTED):
        told = as_told(record, standing, "it came too late")
        assert set(told.verdicts) == {Verdict.NONE}
        assert not contradicts(told, standing)
        assert (told.geometry, told.steering) == (None, None)
        assert (told.steering_axes, told.adjustings) == ((), ())


def test_what_is_kept_of_an_evaluation_holds_no_images_and_all_verdicts() -> None:
    shot: Any = object()
    found = measurement(u=U)
    seen = evaluate(KIND, [result("front_left", found, shot=shot)], 2.0)
    assert seen.wheels[0].result.shot is shot
    kept = seen.without_images()
    assert kept.wheels[0].result.shot is None
    assert kept.wheels[0].result.measurement is found
    assert list(kept.angles) == list(seen.angles)
