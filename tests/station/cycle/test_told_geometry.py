"""What the line is told of a vehicle's geometry, and of what a wheel's angles are those of."""

from __future__ import annotations

from dataclasses import replace

import pytest

from alignment.values import Refusal, RefusalCode
from db.records import CycleOutcome, Verdict
from station.configuration.vehicle_types import VehicleType
from station.cycle.answering.answers import Standing, answers_of
from station.cycle.answering.geometry_answer import geometry_answer
from station.cycle.words.cycle import AxisKind, LiveState, Mode, Outcome, StationState, Stop
from station.cycle.words.geometry import GEOMETRY, NO_GEOMETRY, GeometryAnswer, QuantityState
from tests.station.bench import Bench
from tests.station.cycle.test_turning_wheels import SPUN, TURNING, opened
from tests.station.cycle.test_vehicle_frame import bench_of, seen

TOES = ("front_left.toe_to_thrust", "front_right.toe_to_thrust")


def told(bench: Bench) -> GeometryAnswer:
    """Geometry of the last vehicle, as the line was told it."""
    answer: GeometryAnswer = bench.line.sent[-1][3].geometry
    return answer


def states(geometry: GeometryAnswer) -> dict[str, QuantityState]:
    return {quantity.name: quantity.state for quantity in geometry.quantities}


@pytest.mark.parametrize("reference", ["vehicle", "stand"])
def test_lengths_go_to_the_line_with_their_limits_verdict(reference: str) -> None:
    with bench_of(reference, 0.1) as bench:  # type: ignore[arg-type]
        bench.found = dict(seen(0.1, {"front_left": (5.0, 0.0), "rear_left": (-1.0, 0.0)}))
        bench.trigger()
    found = told(bench)
    assert (found.reference, found.between) == (reference, "sidewalls")
    assert set(states(found)) == set(GEOMETRY)
    assert found.of("wheelbase_difference").state is QuantityState.NOK
    assert found.of("wheelbase_difference").value == pytest.approx(6.0, abs=0.05)
    assert found.of("track_front").state is QuantityState.OK
    assert found.of("wheelbase_left").state is QuantityState.UNJUDGED
    assert found.of("wheelbase_left").value == pytest.approx(2706.0, abs=0.05)
    assert found.of("yaw").value == pytest.approx(0.1, abs=0.02)
    u95 = found.of("track_front").u95
    assert u95 is not None
    assert 0.0 < u95 < 0.1


def test_rigs_in_no_common_frame_tell_no_lengths_and_angles_against_the_stand() -> None:
    with bench_of(None) as bench:
        bench.trigger()
    found = told(bench)
    assert (found.reference, found.between) == ("stand", None)
    assert states(found) == dict.fromkeys(TOES, QuantityState.UNJUDGED)
    assert found.of(TOES[0]).value == pytest.approx(0.0, abs=1e-6)


def test_vehicle_with_a_refused_wheel_has_lengths_that_were_not_measured() -> None:
    with bench_of("vehicle", 0.1) as bench:
        bench.found["rear_left"] = Refusal(RefusalCode.HEAD_DARK, "dark")
        bench.trigger()
    assert set(states(told(bench)).values()) == {QuantityState.NOT_MEASURED}
    assert told(bench).between is None


def test_one_axle_alone_says_what_its_toes_refer_to() -> None:
    with bench_of("stand") as bench:
        bench.trigger(wheels=("front_left", "front_right"))
    assert told(bench) == GeometryAnswer("stand")
    assert bench.line.sent[-1][3].outcome is Outcome.NOT_REQUESTED


@pytest.mark.parametrize("standing", [Standing.ABORTED, Standing.NOT_COMMITTED])
def test_lengths_of_a_record_that_does_not_count_are_not_told(standing: Standing) -> None:
    with bench_of("vehicle") as bench:
        report = bench.trigger()
    assert report is not None
    answers = answers_of(report.record, standing)
    assert answers.vehicle is not None
    assert set(states(answers.vehicle.geometry).values()) == {QuantityState.NOT_MEASURED}
    assert {wheel.kind for wheel in answers.wheels} == {AxisKind.NONE}


def test_nothing_that_was_measured_refers_to_nothing() -> None:
    with bench_of("vehicle") as bench:
        bench.found = dict.fromkeys(bench.found, Refusal(RefusalCode.HEAD_DARK, "dark"))
        report = bench.trigger()
    assert report is not None
    assert geometry_answer(report.record) == NO_GEOMETRY


def test_length_that_rests_on_no_valid_calibration_is_not_measured() -> None:
    with bench_of("stand") as bench:
        report = bench.trigger()
    assert report is not None
    geometry = report.record.geometry
    assert geometry is not None
    found = geometry_answer(replace(report.record, geometry=replace(geometry, verdict=Verdict.NONE)))
    assert found.of("track_front").state is QuantityState.NOT_MEASURED
    assert found.of("track_rear").state is QuantityState.UNJUDGED


@pytest.mark.parametrize(
    ("method", "kind"),
    [
        ("tyre_plane/revolution", AxisKind.TYRE_PLANE),
        ("spin_axis", AxisKind.SPIN_AXIS),
        ("x/degraded", AxisKind.NONE),
        (None, AxisKind.NONE),
    ],
)
def test_kind_of_a_wheel_is_that_of_its_method(method: str | None, kind: AxisKind) -> None:
    """Records of old methods have none, and are told as such after a restart."""
    with bench_of("stand") as bench:
        report = bench.trigger()
    assert report is not None
    wheels = tuple(replace(wheel, method=method) for wheel in report.record.wheels)
    answers = answers_of(replace(report.record, wheels=wheels), Standing.COMMITTED)
    assert {wheel.kind for wheel in answers.wheels} == {kind}
    assert {wheel.run_out_mm for wheel in answers.wheels} == {None}


def test_results_that_are_offered_again_hold_the_same_geometry() -> None:
    """It was told once, from what was in memory, and not after the station's restart."""
    with bench_of("vehicle", 0.1) as bench:
        report = bench.trigger()
    assert report is not None
    again = answers_of(report.record, Standing.COMMITTED)
    assert (again.wheels, again.axles, again.vehicle) == bench.line.sent[-1][1:]


def test_live_angles_are_those_of_the_tyre_plane() -> None:
    with bench_of("stand") as bench:
        bench.line.on_live = lambda: bench.line.at.update({StationState.ADJUSTING: Stop(1)})
        bench.trigger(mode=Mode.ADJUST)
    shown = [live for live, _ in bench.line.live]
    assert {live.kind for live in shown if live.state is LiveState.INSIDE} == {AxisKind.TYRE_PLANE}


@pytest.mark.parametrize(("most_mm", "state"), [(2.5, QuantityState.OK), (1.9, QuantityState.NOK)])
def test_run_out_goes_to_the_line_with_a_verdict_of_its_own(most_mm: float, state: QuantityState) -> None:
    """No turn of a tie rod changes it: the wheel is good, and the line is told of its tyre."""
    axle = SPUN | {"run_out_mm": most_mm}
    axles = {"front": axle, "rear": axle}
    kind = VehicleType.model_validate(TURNING.model_dump(exclude_none=True) | {"axles": axles})
    with opened(types={3: kind}) as bench:
        report = bench.trigger(vehicle_type=3)
    assert report is not None
    for wheel in bench.line.sent[-1][1]:
        assert (wheel.outcome, wheel.kind, wheel.run_out_state) == (Outcome.OK, AxisKind.SPIN_AXIS, state)
        assert wheel.run_out_mm == pytest.approx(2.0, abs=0.06)
        assert 0.0 < wheel.run_out_u95_mm < 0.2
        assert 0.0 <= wheel.high_spot_deg < 360.0
    lost = tuple(replace(wheel, run_out=None, run_out_u=None) for wheel in report.record.wheels)
    answers = answers_of(replace(report.record, wheels=lost, outcome=CycleOutcome.OK), Standing.COMMITTED)
    assert {wheel.run_out_state for wheel in answers.wheels} == {QuantityState.NOT_MEASURED}
    assert {wheel.high_spot_deg for wheel in answers.wheels} == {None}
