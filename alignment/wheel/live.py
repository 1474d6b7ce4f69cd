"""The spin axis live, from single exposures: a tyre plane less the run-out that a series found before.

Where the run-out leans to at an exposure nobody tells. Two explanations are followed side by side, each by
an extended Kalman filter of axis, phase and rate: the rollers turn the wheel on as in the series, or they
stopped and the wheel stands, leaning to where the first exposure shows it. What comes decides between them
(multiple model filter; Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and
Navigation, ch. 11.6). What neither explains, a wheel that was rolled on by hand, ends it: then only a new
series helps.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from alignment.arrays import Array
from alignment.units import ARCMIN
from alignment.values import Side, WheelMeasurement
from alignment.vehicle.angles import camber_toe, camber_toe_jacobian, normal_from_angles
from alignment.wheel.normals import frame_about, normals_of, tilt_and_azimuth
from alignment.wheel.spin import SpinMeasurement

_ADJUSTED = 4.0 * ARCMIN  # by which the axis moves in a second while somebody turns a tie rod
_UNSTEADY = 0.03  # of the rate of the rollers, as the series tells it
_UNEVEN = 0.005  # of it, by which it changes in a second
_NOISE = 0.02 * ARCMIN
_SLOWEST = 1e-3  # rad/s; slower is standing
_LOST = 45.0  # squared surprise of two coordinates, in deviations, that no explanation survives
_LONGEST_S = 30.0  # without an exposure; then a turning wheel may lean anywhere
_LARGEST_U = 3.0 * ARCMIN


class _Track:
    """One explanation: state (axis, axis, phase, rate) and its covariance (4, 4)."""

    def __init__(self, point: Array, axis: Array, axis_u: float, run_out: float, rate: float) -> None:
        lean = point - axis
        phase = math.atan2(lean[1], lean[0])
        outward = np.array([math.cos(phase), math.sin(phase)])
        self.run_out = run_out
        # Along the lean the run-out tells the axis; across it, axis and phase share the error of the axis.
        aside = np.array([-outward[1], outward[0]])
        middle = point - run_out * outward
        self.state = np.array([middle[0], middle[1], phase, rate])
        shared = np.concatenate([aside, [-1.0 / run_out, 0.0]])
        self.covariance = axis_u**2 * np.outer(shared, shared)
        self.covariance[:2, :2] += _NOISE**2 * np.eye(2)
        self.covariance[3, 3] = (_UNSTEADY * rate) ** 2
        self.log_weight = 0.0

    def step(self, point: Array, noise: Array, passed_s: float) -> float:
        """Take an exposure; its squared surprise."""
        move = np.eye(4)
        move[2, 3] = passed_s
        grown = np.diag([_ADJUSTED**2 * passed_s] * 2 + [0.0, (_UNEVEN * self.state[3]) ** 2 * passed_s])
        self.state = move @ self.state
        self.covariance = move @ self.covariance @ move.T + grown
        phase = float(self.state[2])
        outward = np.array([math.cos(phase), math.sin(phase)])
        aside = np.array([-outward[1], outward[0]])
        seen = np.column_stack([np.eye(2), self.run_out * aside, np.zeros(2)])
        missing = point - self.state[:2] - self.run_out * outward
        total = seen @ self.covariance @ seen.T + noise
        gain = self.covariance @ seen.T @ np.linalg.inv(total)
        self.state = self.state + gain @ missing
        left = np.eye(4) - gain @ seen
        self.covariance = left @ self.covariance @ left.T + gain @ noise @ gain.T
        surprise = float(missing @ np.linalg.solve(total, missing))
        self.log_weight -= 0.5 * (surprise + math.log(float(np.linalg.det(total))))
        return surprise


class LiveSpin:
    """Follows the spin axis of one wheel after its series.

    Parameters
    ----------
    spin
        Of the series.
    last
        Tyre plane of the last exposure of the series.
    rate
        Turn of the wheel during the series, radians per second, growing as its phases do.
    side
        Side of the vehicle.
    """

    def __init__(self, spin: SpinMeasurement, last: WheelMeasurement, rate: float, side: Side) -> None:
        self._side = side
        self._frame = frame_about(normal_from_angles(spin.camber, spin.toe, side))
        self._run_out, self._common = spin.run_out, spin.angle_covariance
        self._rate = rate
        self._tracks: list[_Track] = []
        self._seen_s = 0.0
        self._lost = False
        if spin.run_out is not None:
            assert spin.phases is not None
            assert spin.phases_u is not None
            lean = np.array([math.cos(spin.phases[-1]), math.sin(spin.phases[-1])])
            self._axis = self._point(last) - spin.run_out * lean
            self._axis_u = max(_NOISE, spin.run_out * spin.phases_u[-1])

    @property
    def lost(self) -> bool:
        """Whether the wheel does what no explanation allows; only a new series helps."""
        return self._lost

    def take(self, plane: WheelMeasurement, time_s: float) -> WheelMeasurement | None:
        """Return the spin axis at a single exposure; None while it is not known well enough.

        Parameters
        ----------
        plane
            Tyre plane of the exposure.
        time_s
            When it was taken, seconds on the clock of the series' rate.
        """
        if self._run_out is None:
            # No run-out that shows: plane and axis are one, but for what the series says of it.
            return self._as_axis(plane, self._point(plane), self._jacobian() @ np.zeros((2, 2)))
        point = self._point(plane)
        if not self._tracks:
            self._seen_s = time_s
            rates = [0.0] if abs(self._rate) < _SLOWEST else [0.0, self._rate]
            self._tracks = [_Track(point, self._axis, self._axis_u, self._run_out, rate) for rate in rates]
        else:
            self._follow(point, time_s)
        if self._lost:
            return None
        weights = np.array([track.log_weight for track in self._tracks])
        weights = np.exp(weights - weights.max())
        weights /= weights.sum()
        middle = sum((w * t.state[:2] for w, t in zip(weights, self._tracks, strict=True)), np.zeros(2))
        spread = np.zeros((2, 2))
        for weight, track in zip(weights, self._tracks, strict=True):
            off = track.state[:2] - middle
            spread += weight * (track.covariance[:2, :2] + np.outer(off, off))
        if math.sqrt(float(np.linalg.eigvalsh(spread)[-1])) > _LARGEST_U:
            return None
        turn = self._jacobian()
        return self._as_axis(plane, middle, turn @ spread @ turn.T)

    def _follow(self, point: Array, time_s: float) -> None:
        passed_s = max(time_s - self._seen_s, 0.0)
        self._seen_s = time_s
        noise = _NOISE**2 * np.eye(2)
        surprises = [track.step(point, noise, passed_s) for track in self._tracks]
        top = max(track.log_weight for track in self._tracks)
        kept = [
            track
            for track, surprise in zip(self._tracks, surprises, strict=True)
            if track.log_weight > top - _LOST / 2.0 and surprise < _LOST
        ]
        turning = any(track.state[3] for track in kept)
        self._lost = self._lost or not kept or (turning and passed_s > _LONGEST_S)
        self._tracks = kept or self._tracks

    def _point(self, plane: WheelMeasurement) -> Array:
        angle, azimuth = tilt_and_azimuth(
            normal_from_angles(plane.camber, plane.toe, self._side)[None], self._frame
        )
        return np.array([angle[0] * math.cos(azimuth[0]), angle[0] * math.sin(azimuth[0])])

    def _jacobian(self) -> Array:
        out: Array = camber_toe_jacobian(self._frame[2], self._side) @ self._frame[:2].T
        return out

    def _as_axis(self, plane: WheelMeasurement, point: Array, own: Array) -> WheelMeasurement:
        camber, toe = camber_toe(normals_of(point[None], self._frame)[0], self._side)
        return replace(
            plane, camber=camber, toe=toe, angle_covariance=self._common + own, method="spin_axis/live"
        )
