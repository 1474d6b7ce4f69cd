"""The vehicle's own frame in the cycle: what is judged, stored and told of a vehicle that stands askew."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from alignment.geometry.transforms import RigidTransform
from alignment.units import ARCMIN
from alignment.values import (
    Placing,
    Refusal,
    RefusalCode,
    RigCalibration,
    Side,
    WheelMeasurement,
    WheelReference,
    nominal_vehicle_from_rig,
)
from alignment.vehicle.angles import camber_toe, normal_from_angles
from alignment.vehicle.geometry import TYRE_WIDTH
from alignment.vehicle.placed import pose_by_frame
from alignment.vehicle.wheel_axes import Stand, WheelAxis
from db.records import OF_GEOMETRY, CheckOutcome, CycleOutcome, Verdict, WheelKind
from station.configuration.vehicle_types import VehicleType
from station.cycle.judging.evaluation import evaluate, missed_limits
from station.cycle.judging.verdict import Status
from station.cycle.wheels.frame import CommonFrame, Reference
from station.cycle.wheels.positions import WheelResult
from station.cycle.words.cycle import ErrorCode, LiveState, Mode, Outcome, StationState, Stop
from tests.sensors.samples import calibration as sample_calibration
from tests.station.bench import WHEELS, Bench, measurement, open_bench

PLACES = {
    "front_left": (1350.0, 850.0, 0.0),
    "front_right": (1350.0, -850.0, 0.0),
    "rear_left": (-1350.0, 850.0, 0.0),
    "rear_right": (-1350.0, -850.0, 0.0),
}
"""Of the rigs, and of the reference points of a vehicle that stands straight."""
LIMIT = {"nominal_deg": 0.0, "tolerance_deg": 0.08}
AXLE = {"camber": {"nominal_deg": 0.0, "tolerance_deg": 0.5}, "toe": LIMIT, "total_toe": LIMIT}
LENGTHS = {
    "track_front": {"nominal_mm": 1700.0, "tolerance_mm": 2.0},
    "wheelbase_difference": {"lower_mm": -2.0, "upper_mm": 2.0},
}
KIND = VehicleType.model_validate(
    {
        "number": 1,
        "name": "Car",
        "axles": {"front": AXLE, "rear": AXLE},
        "thrust_angle": LIMIT,
        "lengths": LENGTHS,
        "tyre_width_sigma_mm": 0.0,
    }
)


def side_of(name: str) -> Side:
    return "left" if name.endswith("left") else "right"


def seen(yaw_deg: float, moved: dict[str, tuple[float, float]] | None = None) -> dict[str, WheelMeasurement]:
    """What the rigs see of a vehicle with wheels at zero that has turned on the stand; points moved in it."""
    turn = RigidTransform.from_rotvec(np.array([0.0, 0.0, math.radians(yaw_deg)]), np.zeros(3))
    out = {}
    for name, place in PLACES.items():
        side = side_of(name)
        camber, toe = camber_toe(turn.apply_vectors(normal_from_angles(0.0, 0.0, side)), side)
        point = np.array(place)
        point[:2] += (moved or {}).get(name, (0.0, 0.0))
        rig = RigidTransform(nominal_vehicle_from_rig(side).rotation, np.array(place))
        covariance = np.diag([2e-6, 2e-6, 0.01, 0.01, 0.01]) ** 2
        out[name] = replace(
            measurement(camber, toe),
            angle_covariance=covariance[:2, :2],
            reference=WheelReference(rig.inverse().apply(turn.apply(point)), covariance),
        )
    return out


@contextmanager
def bench_of(reference: Reference | None, yaw_deg: float = 0.0, kind: VehicleType = KIND) -> Iterator[Bench]:
    """A bench whose rigs stand in one frame, or do not."""
    frame = None if reference is None else CommonFrame(Stand(), reference)
    with open_bench(frame=frame, places=PLACES) as bench:
        bench.types[1] = kind
        bench.found = dict(seen(yaw_deg))
        yield bench


@pytest.fixture
def askew() -> Iterator[Bench]:
    """A vehicle of zero toe, turned by 0.1° to the left, before rigs whose toes refer to the vehicle."""
    with bench_of("vehicle", 0.1) as bench:
        yield bench


def test_stands_own_way_takes_a_tenth_of_a_degree_of_yaw_for_toe_and_thrust() -> None:
    """6′ on each side, and a thrust angle that the vehicle has not: a good vehicle was NOK."""
    with bench_of("stand", 0.1) as bench:
        report = bench.trigger()
    assert report is not None
    toes = {wheel.wheel: wheel.toe / ARCMIN for wheel in report.record.wheels if wheel.toe is not None}
    assert toes == {name: pytest.approx(-6.0 if name.endswith("left") else 6.0, abs=1e-6) for name in WHEELS}
    assert report.record.vehicle_angles is not None
    assert report.record.vehicle_angles.thrust_angle == pytest.approx(6.0 * ARCMIN)
    assert report.told is Outcome.NOK


def test_in_its_own_frame_the_same_vehicle_is_good(askew: Bench) -> None:
    report = askew.trigger()
    assert report is not None
    assert report.told is Outcome.OK
    for wheel in report.record.wheels:
        assert wheel.toe == pytest.approx(0.0, abs=1e-9)
        assert wheel.verdict is Verdict.OK
        assert wheel.warning is None
    assert report.record.vehicle_angles is not None
    assert report.record.vehicle_angles.thrust_angle == pytest.approx(0.0, abs=1e-9)
    vehicle = report.evaluation.vehicle
    assert vehicle is not None
    assert vehicle.geometry is not None
    assert vehicle.geometry.value("yaw") == pytest.approx(math.radians(0.1))
    assert vehicle.geometry.value("track_front") == pytest.approx(1700.0)
    assert report.evaluation.reference == "vehicle"


def test_total_toe_is_the_same_in_both_frames() -> None:
    totals = []
    for reference in ("vehicle", "stand"):
        with bench_of(reference, 0.3) as bench:  # type: ignore[arg-type]
            report = bench.trigger()
        assert report is not None
        totals.append({axle.axle: axle.total_toe for axle in report.record.axles})
    assert totals[0] == {axle: pytest.approx(value, abs=1e-4 * ARCMIN) for axle, value in totals[1].items()}


@pytest.mark.parametrize("reference", ["vehicle", "stand"])
def test_length_out_of_its_limits_makes_the_vehicle_nok(reference: Reference) -> None:
    """Whatever toes refer to: rigs in one frame know the lengths."""
    with bench_of(reference) as bench:
        bench.found = dict(seen(0.0, {"front_left": (5.0, 0.0), "rear_left": (-1.0, 0.0)}))
        report = bench.trigger()
        events = [event for event in bench.store.events if event.code == "geometry"]
    assert report is not None
    assert report.record.outcome is CycleOutcome.NOK
    assert report.told is Outcome.NOK
    assert bench.line.sent[-1][3].outcome is Outcome.NOK
    assert all(wheel.outcome is Outcome.OK for wheel in bench.line.sent[-1][1])
    assert report.record.vehicle_angles is not None
    assert report.record.vehicle_angles.verdict is Verdict.NOK
    (said,) = missed_limits(report.evaluation)
    assert "wheelbase_difference is 6.000" in said
    assert "mm" in said
    (event,) = events
    assert "wheelbase_difference is 6.000" in event.text
    assert "accepted are -2 to 2 mm" in event.text
    assert event.cycle_uuid == report.record.uuid


@pytest.mark.parametrize(("yaw_deg", "told"), [(0.1, Outcome.OK), (0.3, Outcome.NOK)])
def test_vehicle_that_stands_too_far_askew_is_nok_by_its_yaw(yaw_deg: float, told: Outcome) -> None:
    kind = VehicleType.model_validate(
        KIND.model_dump(exclude_none=True) | {"yaw": {"nominal_deg": 0.0, "tolerance_deg": 0.2}}
    )
    with bench_of("vehicle", yaw_deg, kind) as bench:
        report = bench.trigger()
    assert report is not None
    assert report.told is told


def test_geometry_is_stored_with_limits_and_says_what_toes_refer_to(askew: Bench) -> None:
    """Lengths were judged and kept nowhere but in the words of an event."""
    report = askew.trigger()
    assert report is not None
    found = report.record.geometry
    assert found is not None
    assert (found.reference, found.end_points, found.verdict) == ("vehicle", "sidewalls", Verdict.OK)
    assert (found.track_front, found.track_front_low, found.track_front_high) == (
        pytest.approx(1700.0), 1698.0, 1702.0,
    )  # fmt: skip
    assert (found.wheelbase_left, found.wheelbase_left_low) == (pytest.approx(2700.0), None)
    assert found.yaw == pytest.approx(math.radians(0.1))
    assert all(getattr(found, f"{name}_u") > 0.0 for name in OF_GEOMETRY)
    assert {wheel.kind for wheel in report.record.wheels} == {WheelKind.TYRE_PLANE}
    with bench_of("stand") as bench:
        by_stand = bench.trigger()
    assert by_stand is not None
    assert by_stand.record.geometry is not None
    assert by_stand.record.geometry.reference == "stand"
    assert all(wheel.toe_tyre_u is None for wheel in by_stand.record.wheels)
    with bench_of(None) as bench:
        assert bench.trigger().record.geometry is None  # type: ignore[union-attr]


def test_lengths_with_limits_of_a_vehicle_with_a_refused_wheel_are_stored_as_not_measured(
    askew: Bench,
) -> None:
    askew.found["rear_left"] = Refusal(RefusalCode.HEAD_DARK, "dark")
    report = askew.trigger()
    assert report is not None
    found = report.record.geometry
    assert found is not None
    assert (found.end_points, found.verdict, found.reference) == (None, Verdict.NONE, "stand")
    assert (found.track_front, found.track_front_low) == (None, 1698.0)


def test_lengths_are_judged_with_the_guard_band() -> None:
    with bench_of("vehicle") as bench:
        bench.found = dict(seen(0.0, {"front_left": (1.97, 0.0)}))
        assert bench.trigger().told is Outcome.NOK  # type: ignore[union-attr]
    with bench_of("vehicle", kind=KIND.model_copy(update={"guard_band": False})) as bench:
        bench.found = dict(seen(0.0, {"front_left": (1.97, 0.0)}))
        assert bench.trigger().told is Outcome.OK  # type: ignore[union-attr]


def test_rigs_in_no_common_frame_judge_no_lengths() -> None:
    with bench_of(None) as bench:
        bench.found = dict(seen(0.0, {"front_left": (50.0, 0.0)}))
        report = bench.trigger()
    assert report is not None
    assert report.told is Outcome.OK
    assert report.evaluation.vehicle is not None
    assert report.evaluation.vehicle.lengths == ()


def test_vehicle_with_a_refused_wheel_has_no_toe_that_could_pass(askew: Bench) -> None:
    """Stored toes of the others are against the stand, say so, and have no verdict."""
    askew.found["rear_left"] = Refusal(RefusalCode.HEAD_DARK, "dark")
    report = askew.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.FAULT
    for wheel in report.record.wheels:
        assert wheel.verdict is Verdict.NONE
        if wheel.wheel != "rear_left":
            assert wheel.toe is not None
            assert abs(wheel.toe) == pytest.approx(6.0 * ARCMIN)
            assert "against the stand's axis" in str(wheel.warning)
    front = next(axle for axle in report.record.axles if axle.axle == "front")
    assert front.verdict is Verdict.OK
    assert report.record.vehicle_angles is None


def test_wheel_without_a_place_is_refused_where_toes_refer_to_the_vehicle(askew: Bench) -> None:
    askew.found["front_right"] = replace(seen(0.1)["front_right"], reference=None)
    report = askew.trigger()
    assert report is not None
    wheel = next(each for each in report.record.wheels if each.wheel == "front_right")
    assert wheel.reason_code == "no_place"
    assert "outermost ring" in str(wheel.reason_text)
    assert report.told is Outcome.FAULT


def test_length_that_is_judged_and_cannot_be_known_is_a_fault_that_says_so() -> None:
    """Of a stand that clamps the vehicle toes stand, and a track without a place is no pass."""
    with bench_of("stand") as bench:
        bench.found["front_right"] = replace(seen(0.0)["front_right"], reference=None)
        report = bench.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.FAULT
    assert "places of all four wheels, found none of front_right" in str(report.record.reason_text)
    assert report.told is Outcome.FAULT


def test_wheels_that_make_no_vehicle_are_a_fault_that_says_so(askew: Bench) -> None:
    """A vehicle turned by 12° is none; its wheels alone are good."""
    askew.found = {
        name: replace(askew.found["front_left"], camber=0.0, toe=0.0, reference=found.reference)  # type: ignore[union-attr, type-var]
        for name, found in seen(12.0).items()
    }
    report = askew.trigger()
    assert report is not None
    assert report.record.outcome is CycleOutcome.FAULT
    assert "within 10°" in str(report.record.reason_text)
    assert report.told is Outcome.FAULT


@pytest.mark.parametrize("wheels", [WHEELS[:2], WHEELS[2:], WHEELS[:3], WHEELS[:1]])
def test_part_of_a_vehicle_has_no_toe_of_its_own_and_is_refused(
    askew: Bench, wheels: tuple[str, ...]
) -> None:
    assert askew.trigger(wheels=wheels) is None
    assert askew.line.refused == [(1, ErrorCode.WHEEL_NOT_AVAILABLE)]
    with bench_of("stand") as bench:
        assert bench.trigger(wheels=wheels) is not None


def test_master_wheels_are_checked_against_the_stand_one_by_one() -> None:
    """Their certificates know no centreline."""
    with bench_of("vehicle") as bench:
        report = bench.trigger(wheels=WHEELS[:1], vehicle_type=7, mode=Mode.MASTER_CHECK)
    assert report is not None
    assert report.told is Outcome.OK
    assert report.evaluation.reference == "stand"
    assert len(bench.store.checks) == 1


def test_live_toe_is_the_one_that_will_be_judged(askew: Bench) -> None:
    """Shown against the stand it led the operator 6′ astray, and the verdict after it was another."""
    shown: dict[str, Any] = {}

    def stop() -> None:
        for angles, _ in askew.line.live:
            if angles.state is LiveState.INSIDE:
                shown[angles.wheel] = angles
        if set(shown) == set(WHEELS):
            askew.line.queue.append(Stop(1))

    askew.line.on_live = stop
    report = askew.trigger(mode=Mode.ADJUST)
    assert report is not None
    assert report.told is Outcome.OK
    for wheel in WHEELS:
        assert shown[wheel].toe_deg == pytest.approx(0.0, abs=1e-9)
    # Before all four were seen there was no centreline, and nothing to show.
    assert all(
        angles.toe_deg is None for angles, _ in askew.line.live if angles.state is LiveState.NOT_MEASURED
    )
    assert askew.line.status.state is StationState.IDLE


def test_spread_of_tyre_widths_is_in_the_stored_uncertainty_of_toe_and_not_of_total_toe() -> None:
    wide = KIND.model_copy(update={"tyre_width_sigma_mm": 1.0})
    records = []
    for kind in (KIND, wide):
        with bench_of("vehicle", kind=kind) as bench:
            report = bench.trigger()
        assert report is not None
        records.append(report)
    narrow, spread = (report.record for report in records)
    assert spread.wheels[0].toe_u > 5.0 * narrow.wheels[0].toe_u  # type: ignore[operator]
    assert spread.axles[0].total_toe_u == pytest.approx(narrow.axles[0].total_toe_u)
    shares = [report.record.wheels[0].toe_tyre_u / report.record.wheels[0].toe_u for report in records]  # type: ignore[operator]
    assert shares[0] == 0.0
    assert 0.9 < shares[1] ** 2 < 1.0
    assert spread.geometry is not None
    assert spread.vehicle_angles is not None
    assert 0.9 * spread.vehicle_angles.thrust_angle_u < spread.geometry.thrust_angle_tyre_u  # type: ignore[operator]
    geometry = records[1].evaluation.vehicle.geometry  # type: ignore[union-attr]
    assert geometry is not None
    assert geometry.share("front_left.toe", TYRE_WIDTH) > 0.9


def test_wheel_whose_calibration_is_not_valid_spoils_every_toe_of_the_vehicle(askew: Bench) -> None:
    """The centreline rests on all four rigs."""
    report = askew.trigger()
    assert report is not None
    results = [
        replace(wheel.result, calibration_valid=wheel.result.wheel != "rear_right")
        for wheel in report.evaluation.wheels
    ]
    judged = evaluate(KIND, results, 2.0, CommonFrame(Stand(), "vehicle"))
    for wheel in judged.wheels:
        assert wheel.toe.status is Status.INVALID
        invalid = wheel.result.wheel == "rear_right"
        assert wheel.camber.status is (Status.INVALID if invalid else Status.OK)


NARROW = {"nominal_deg": 0.0, "tolerance_deg": 0.15}
MASTER_AXLE = {"camber": NARROW, "toe": NARROW}


def master_vehicle(tolerance_mm: float = 0.5) -> VehicleType:
    lengths = {
        "track_front": {"nominal_mm": 1700.0, "tolerance_mm": tolerance_mm},
        "wheelbase_left": {"nominal_mm": 2700.0, "tolerance_mm": tolerance_mm},
        "offset_front": {"nominal_mm": 0.0, "tolerance_mm": 50.0},
    }
    axles = {"front": MASTER_AXLE, "rear": MASTER_AXLE}
    return VehicleType.model_validate(
        KIND.model_dump(exclude_none=True) | {"lengths": lengths, "axles": axles}
    )


def test_master_vehicle_is_checked_against_its_own_centreline_with_its_lengths() -> None:
    """A master vehicle that stood askew by 0.1° had 6′ of false toe, and its lengths checked nothing."""
    with bench_of("vehicle", 0.1, kind=master_vehicle()) as bench:
        report = bench.trigger(mode=Mode.MASTER_CHECK)
        assert report is not None
        assert report.evaluation.reference == "vehicle"
        assert len(bench.store.checks) == 4
        for check in bench.store.checks:
            assert check.outcome is CheckOutcome.WITHIN
            assert check.reason.endswith("so are the 2 certified lengths of the vehicle")
            assert check.as_found is not None
            assert check.as_found["track_front_mm"] == pytest.approx(1700.0)
            assert check.as_found["wheelbase_left_low_mm"] == 2699.5
            assert "offset_front_mm" not in check.as_found


def test_length_of_a_master_vehicle_that_is_out_speaks_against_all_of_its_rigs() -> None:
    with bench_of("vehicle", kind=master_vehicle()) as bench:
        bench.found = dict(seen(0.0, {"front_left": (0.0, 0.8)}))
        bench.trigger(mode=Mode.MASTER_CHECK)
        assert [check.outcome for check in bench.store.checks] == 4 * [CheckOutcome.OUT]
        assert all(
            "track front 1700.800 mm, certified 1699.5 to 1700.5 mm" in check.reason
            for check in bench.store.checks
        )


def test_ordinary_limits_of_lengths_are_no_master_s() -> None:
    with bench_of("vehicle", kind=master_vehicle(10.0)) as bench:
        bench.found = dict(seen(0.0, {"front_left": (0.0, 8.0)}))
        bench.trigger(mode=Mode.MASTER_CHECK)
        assert [check.outcome for check in bench.store.checks] == 4 * [CheckOutcome.WITHIN]
        assert all("track_front_mm" not in (check.as_found or {}) for check in bench.store.checks)
        (event,) = [event for event in bench.store.events if event.code == "no_master"]
        assert "no check of wheelbase left, track front" in event.text
        assert "wider than ±4 mm" in event.text


def test_what_rigs_of_one_view_share_is_counted_once_for_the_vehicle() -> None:
    """A frame that stood askew by 2′ when the rigs saw it made every single toe uncertain by as much."""
    shared = np.diag([0.0, 0.0, 2.0 * ARCMIN, 0.0, 0.0, 0.0, 0.0]) ** 2
    rigs, results = {}, []
    for name, place in PLACES.items():
        pose = RigidTransform(nominal_vehicle_from_rig(side_of(name)).rotation, np.array(place))
        by = pose_by_frame(pose)
        rigs[name] = replace(
            sample_calibration(rig=name, covariance=False),
            side=side_of(name),
            vehicle_from_rig=pose,
            vehicle_from_rig_measured=True,
            placing=Placing("gauge, seen once", by @ shared @ by.T, shared),
        )
        found = seen(0.0)[name]
        assert found.reference is not None
        axis = WheelAxis.of(found, found.reference, rigs[name])
        results.append(WheelResult(name, "c", True, found, None, axis=axis))
    u = {}
    for case, known in {"one view": rigs, "views of their own": _apart(rigs), "not said": {}}.items():
        judged = evaluate(KIND, results, 2.0, CommonFrame(Stand(), "vehicle", known))
        assert judged.vehicle is not None
        assert judged.vehicle.geometry is not None
        u[case] = judged.vehicle.geometry.u("front_left.toe"), judged.vehicle.geometry.u("yaw")
    assert u["one view"][0] == pytest.approx(u["not said"][0], rel=0.01)
    assert u["views of their own"][0] > 1.0 * ARCMIN
    assert u["one view"][1] == pytest.approx(math.hypot(u["not said"][1], 2.0 * ARCMIN), rel=0.01)


def _apart(rigs: dict[str, RigCalibration]) -> dict[str, RigCalibration]:
    return {
        name: replace(rig, placing=replace(rig.placing, view=name))  # type: ignore[type-var]
        for name, rig in rigs.items()
    }
