import math
from dataclasses import FrozenInstanceError

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import DegenerateInputError
from db.records import CycleOutcome, Verdict
from station.configuration.limits import Limits
from station.cycle.judging.verdict import Angle, Status, combined, cycle_outcome, missed_in_words

LIMITS = Limits(-0.01, 0.01)
ANGLE = Angle("front_left.toe", LIMITS)
NARROW = 1e-4

any_float = st.floats(allow_nan=True, allow_infinity=True)
limits = st.tuples(st.floats(-1, 1), st.floats(1e-6, 1)).map(lambda p: Limits(p[0], p[0] + p[1]))


def measured(value: float, uncertainty: float = NARROW, *, angle: Angle = ANGLE, valid: bool = True) -> Angle:
    return angle.measured(value, uncertainty, calibration_valid=valid)


OK, NOK = measured(0.0), measured(0.5)
UNSET, INVALID = ANGLE, measured(math.nan)
UNJUDGED = measured(0.0, angle=Angle("front_left.toe", None))


def test_declared_angle_is_unset_and_no_pass() -> None:
    assert ANGLE.status is Status.UNSET
    assert ANGLE.status.verdict is Verdict.NONE


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_value_that_is_no_finite_number_is_invalid(value: float) -> None:
    assert measured(value).status is Status.INVALID


@pytest.mark.parametrize("uncertainty", [0.0, -1e-4, math.nan, math.inf])
def test_value_without_a_real_uncertainty_is_invalid(uncertainty: float) -> None:
    assert measured(0.0, uncertainty).status is Status.INVALID


def test_value_set_without_uncertainty_at_all_is_invalid() -> None:
    assert Angle("toe", LIMITS, value=0.0, calibration_valid=True).status is Status.INVALID


def test_value_without_valid_calibration_is_invalid_even_outside_the_limits() -> None:
    assert measured(0.0, valid=False).status is Status.INVALID
    assert measured(1.0, valid=False).status is Status.INVALID


def test_angle_without_limits_is_not_judged() -> None:
    assert UNJUDGED.status is Status.UNJUDGED


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_guard_band_takes_the_uncertainty_from_both_limits(sign: float) -> None:
    inside, between = sign * 0.0094, sign * 0.0096
    assert measured(inside, 5e-4).status is Status.OK
    assert measured(between, 5e-4).status is Status.NOK
    assert measured(between, 5e-4, angle=Angle("toe", LIMITS, guard_band=False)).status is Status.OK
    assert measured(sign * 0.0101, 5e-4, angle=Angle("toe", LIMITS, guard_band=False)).status is Status.NOK


def test_limits_belong_to_the_accepted_range() -> None:
    plain = Angle("toe", LIMITS, guard_band=False)
    assert measured(0.01, angle=plain).status is Status.OK
    assert measured(-0.01, angle=plain).status is Status.OK


def test_uncertainty_wider_than_the_tolerance_accepts_nothing() -> None:
    assert measured(0.0, 0.011).status is Status.NOK


@pytest.mark.parametrize("pair", [(1.0, 1.0), (1.0, 0.0), (math.nan, 1.0), (0.0, math.inf), (-math.inf, 0.0)])
def test_limits_out_of_order_or_not_finite_are_refused(pair: tuple[float, float]) -> None:
    with pytest.raises(DegenerateInputError, match="low below high"):
        Limits(*pair)


@pytest.mark.parametrize(
    ("angles", "status"),
    [
        ([], Status.UNSET),
        ([OK], Status.OK),
        ([OK, UNJUDGED], Status.OK),
        ([UNJUDGED], Status.UNJUDGED),
        ([OK, NOK], Status.NOK),
        ([OK, NOK, UNSET], Status.UNSET),
        ([OK, UNSET, INVALID, NOK], Status.INVALID),
    ],
)
def test_several_angles_are_as_good_as_the_worst_known_of_them(angles: list[Angle], status: Status) -> None:
    assert combined(angles) is status


@pytest.mark.parametrize(
    ("angles", "fault", "aborted", "outcome"),
    [
        ([OK], False, False, CycleOutcome.OK),
        ([OK, NOK], False, False, CycleOutcome.NOK),
        ([OK, UNSET], False, False, CycleOutcome.FAULT),
        ([OK, INVALID], False, False, CycleOutcome.FAULT),
        ([UNJUDGED], False, False, CycleOutcome.FAULT),
        ([], False, False, CycleOutcome.FAULT),
        ([OK], True, False, CycleOutcome.FAULT),
        ([NOK], True, False, CycleOutcome.FAULT),
        ([OK], False, True, CycleOutcome.ABORTED),
        ([UNSET], True, True, CycleOutcome.ABORTED),
    ],
)
def test_vehicle_station_and_operator_are_kept_apart(
    angles: list[Angle], fault: bool, aborted: bool, outcome: CycleOutcome
) -> None:
    assert cycle_outcome(angles, fault=fault, aborted=aborted) is outcome


angles = st.builds(
    Angle,
    name=st.just("angle"),
    limits=st.none() | limits,
    guard_band=st.booleans(),
    value=st.none() | any_float,
    expanded_uncertainty=st.none() | any_float,
    calibration_valid=st.booleans(),
)


@given(angles)
def test_no_input_whatsoever_is_ok_without_value_uncertainty_calibration_and_limits(angle: Angle) -> None:
    if angle.status is not Status.OK:
        return
    assert angle.value is not None
    assert math.isfinite(angle.value)
    assert angle.expanded_uncertainty is not None
    assert 0 < angle.expanded_uncertainty < math.inf
    assert angle.calibration_valid
    assert angle.limits is not None
    assert angle.limits.low <= angle.value <= angle.limits.high


@given(limits, st.floats(0, 1), st.floats(1e-9, 1e-3))
def test_value_well_inside_its_limits_is_ok(accepted: Limits, share: float, uncertainty: float) -> None:
    value = accepted.low + share * (accepted.high - accepted.low)
    status = measured(value, uncertainty, angle=Angle("a", accepted)).status
    margin = min(value - accepted.low, accepted.high - value)
    if margin > uncertainty * 1.001 + 1e-12:
        assert status is Status.OK
    if margin < uncertainty * 0.999 - 1e-12:
        assert status is Status.NOK


@given(st.lists(angles, max_size=6), st.booleans(), st.booleans())
def test_cycle_is_ok_only_when_every_angle_has_its_value(
    declared: list[Angle], fault: bool, aborted: bool
) -> None:
    outcome = cycle_outcome(declared, fault=fault, aborted=aborted)
    if outcome is CycleOutcome.OK:
        assert not fault
        assert not aborted
        assert all(angle.status in (Status.OK, Status.UNJUDGED) for angle in declared)
        assert any(angle.status is Status.OK for angle in declared)
    if outcome is CycleOutcome.NOK:
        assert any(angle.status is Status.NOK for angle in declared)
        assert all(angle.value is not None for angle in declared)


@pytest.mark.parametrize(
    ("angle", "verdict"),
    [
        (OK, Verdict.OK),
        (NOK, Verdict.NOK),
        (UNSET, Verdict.NONE),
        (INVALID, Verdict.NONE),
        (UNJUDGED, Verdict.NONE),
    ],
)
def test_only_ok_and_nok_are_stored_as_verdicts(angle: Angle, verdict: Verdict) -> None:
    assert angle.status.verdict is verdict


def test_calibration_is_not_valid_unless_somebody_says_so() -> None:
    assert Angle("toe", LIMITS, value=0.0, expanded_uncertainty=NARROW).status is Status.INVALID


def test_guard_band_is_applied_unless_somebody_says_otherwise() -> None:
    assert Angle("toe", LIMITS).guard_band


@pytest.mark.parametrize("value", [OK, LIMITS])
def test_what_was_judged_cannot_be_changed_afterwards(value: object) -> None:
    with pytest.raises(FrozenInstanceError):
        value.low = value.value = 0.0  # type: ignore[attr-defined]


def test_an_angle_that_only_its_uncertainty_makes_nok_says_so() -> None:
    inside = Angle("front_left.toe", Limits(-0.01, 0.01)).measured(0.0099, 0.0002, calibration_valid=True)
    assert missed_in_words(inside) == (
        "front_left toe +0.5672°, limits -0.5730° to +0.5730° less its uncertainty of 0.0115°"
    )
    outside = Angle("front_left.toe", Limits(-0.01, 0.01)).measured(0.011, 0.0002, calibration_valid=True)
    assert missed_in_words(outside) == "front_left toe +0.6303°, limits -0.5730° to +0.5730°"
