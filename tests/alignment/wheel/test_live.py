"""The spin axis live: the run-out of a series is taken off single exposures, or nothing is shown."""

from __future__ import annotations

import math

import numpy as np
import pytest

from alignment.units import ARCMIN
from alignment.values import WheelMeasurement
from alignment.vehicle.angles import camber_toe
from alignment.wheel.live import LiveSpin
from alignment.wheel.series import fit_series
from alignment.wheel.spin import SpinMeasurement
from sensors.simulation.scene import WheelPose
from tests.alignment.wheel.test_series import NOISE, RULES, RUN_OUT, STEP, exposures, plane

INTERVAL_S = 0.26
RATE = STEP / INTERVAL_S


def after_a_series(seed: int) -> tuple[LiveSpin, np.ndarray, float, np.random.Generator]:
    """A wheel after its series: axis (camber, toe) and turn of its last exposure."""
    rng = np.random.default_rng([3, seed])
    planes, axes = exposures(rng)
    found = fit_series(planes, "left", RULES)
    assert isinstance(found, SpinMeasurement)
    phases = np.unwrap(np.array(found.phases))
    rate = float(phases[-1] - phases[0]) / (15 * INTERVAL_S)
    # The simulator counts its turn from another direction than phases.
    pose = WheelPose(*axes[-1], 0.0, RUN_OUT)
    lean = camber_toe(pose.vehicle_from_tyre("left")[:, 2], "left")
    zero = math.atan2(lean[1] - axes[-1][1], -(lean[0] - axes[-1][0]))
    return LiveSpin(found, planes[-1], rate, "left"), axes[-1], found.phases[-1] - zero, rng  # type: ignore[index]


def seen(axis: np.ndarray, spin: float, rng: np.random.Generator) -> WheelMeasurement:
    pose = WheelPose(float(axis[0]), float(axis[1]), spin, RUN_OUT)
    angles = camber_toe(pose.vehicle_from_tyre("left")[:, 2], "left") + NOISE * rng.normal(size=2)
    return plane(*angles, np.zeros(3))


@pytest.mark.parametrize("turning", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_the_axis_is_followed_while_somebody_turns_the_tie_rod(turning: bool, seed: int) -> None:
    """A plane alone is eleven minutes off, one way or the other."""
    live, axis, spin, rng = after_a_series(seed)
    errors, planes = [], []
    if not turning:
        spin += 1.3  # until the rollers stood
    for k in range(60):
        time_s = 10.0 + 0.2 * k
        if turning:
            spin += RATE * 0.2 * (1.0 + 0.005 * rng.normal())
        at = axis + np.array([0.0, 20.0 * ARCMIN * min(1.0, max(0.0, (k - 10) / 30.0))])
        shot = seen(at, spin, rng)
        found = live.take(shot, time_s)
        planes.append(abs(np.array([shot.camber, shot.toe]) - at).max() / ARCMIN)
        if found is not None and k >= 10:
            off = np.array([found.camber, found.toe]) - at
            errors.append(off / ARCMIN)
            assert np.abs(off / (found.camber_u, found.toe_u)).max() <= 5.0
    assert not live.lost
    assert len(errors) == 50
    assert np.abs(errors).max() <= 1.5
    assert max(planes) > 7.0


def test_a_wheel_that_is_rolled_on_by_hand_shows_nothing_rather_than_a_wrong_axis() -> None:
    live, axis, spin, rng = after_a_series(1)
    for k in range(10):
        assert live.take(seen(axis, spin, rng), 0.2 * k) is not None
    shown = [live.take(seen(axis, spin + 2.5 + 0.9 * k, rng), 2.0 + 0.2 * k) for k in range(8)]
    assert shown[-1] is None
    assert live.lost


def test_a_wheel_without_run_out_is_its_plane() -> None:
    planes, axes = exposures(np.random.default_rng(4), run_out=0.0, wander=0.3 * ARCMIN)
    found = fit_series(planes, "left", RULES, turned=lambda: True)
    assert isinstance(found, SpinMeasurement)
    live = LiveSpin(found, planes[-1], RATE, "left")
    shot = plane(axes[0][0] + 0.001, axes[0][1], np.zeros(3))
    shown = live.take(shot, 1.0)
    assert shown is not None
    assert (shown.camber, shown.toe) == pytest.approx((shot.camber, shot.toe), abs=1e-9)
    assert shown.method == "spin_axis/live"
