"""Straight ahead: what the angle of the steering wheel says of the toe of the front wheels.

With the steering wheel turned to the left, both front wheels point to the left of where they point straight
ahead: the left one shows less toe and the right one as much more. So individual toe is corrected by the turn
of the front wheels, with what is not known of it; total toe keeps its value. That the inner wheel turns more
than the outer one (Ackermann) is of second order: at most `most_toe_out`, which counts as uncertainty.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

from alignment.vehicle import AxleAngles, WheelAngles
from station.configuration import SteeringOptions
from station.cycle.words import SteeringWheel

LARGEST_BELIEVED_DEG = 1080.0
"""A steering wheel turns three times to each side at most, degrees."""
WIDEST_TRACK = 0.7
"""Largest track of a vehicle, as a part of its wheelbase."""
NOT_CHECKED = "straight ahead not checked"
STEERED = {"front_left": 1.0, "front_right": -1.0}
"""Steered wheels, and the sign of the correction of their toe for a steering wheel turned to the left."""


class StraightAheadState(enum.StrEnum):
    """What is known of straight ahead.

    NOT_ASKED: the vehicle type says nothing of its steering, or no front wheel was asked for. CHECKED: toe is
    brought to straight ahead. NOT_CHECKED: no angle counts, and the vehicle type lets toe be judged as it
    stands. REFUSED: toe is not judged.
    """

    NOT_ASKED = "not_asked"
    CHECKED = "checked"
    NOT_CHECKED = "not_checked"
    REFUSED = "refused"


@dataclass(frozen=True)
class SteeringFound:
    """How the steering wheel stood, and what follows for the front wheels.

    Attributes
    ----------
    state
        What is known.
    reason
        Why it is not checked, or refused, in words; None where it is checked or was not asked for.
    wheel, wheel_u
        Angle of the steering wheel from straight, radians, positive to the left, and its standard
        uncertainty; None where none counts.
    age_s
        Of the oldest angle that was told, seconds.
    steer, steer_u
        Turn of the front wheels from straight ahead, radians, positive to the left, by which toe is
        corrected, and its standard uncertainty; 0 where it is not.
    """

    state: StraightAheadState
    reason: str | None = None
    wheel: float | None = None
    wheel_u: float | None = None
    age_s: float | None = None
    steer: float = 0.0
    steer_u: float = 0.0

    @property
    def refused(self) -> bool:
        """Whether front toe is not judged."""
        return self.state is StraightAheadState.REFUSED

    @property
    def toe_out_u(self) -> float:
        """Standard uncertainty of the toe of each front wheel for the second order of the turn, radians."""
        return most_toe_out(self.steer) / math.sqrt(3.0)

    def wheel_at_straight(self, name: str, raw: WheelAngles) -> WheelAngles:
        """Return the angles of a wheel, its toe at straight ahead where that was checked."""
        sign = STEERED.get(name)
        if self.state is not StraightAheadState.CHECKED or sign is None:
            return raw
        toe_u = math.hypot(raw.toe_u, self.steer_u, self.toe_out_u)
        return WheelAngles(raw.camber, raw.toe + sign * self.steer, raw.camber_u, toe_u)

    def axle_at_straight(self, axle: str, raw: AxleAngles) -> AxleAngles:
        """Return the angles of an axle: values stay, the second order counts in their uncertainty."""
        if self.state is not StraightAheadState.CHECKED or axle != "front":
            return raw
        total_toe_u = math.hypot(raw.total_toe_u, 2.0 * self.toe_out_u)
        return AxleAngles(raw.total_toe, raw.camber_difference, total_toe_u, raw.camber_difference_u)


NOTHING_ASKED = SteeringFound(StraightAheadState.NOT_ASKED)


def most_toe_out(steer: float) -> float:
    """Return how far each front wheel may toe out beyond `steer`, radians: ½ · track/wheelbase · steer²."""
    return 0.5 * WIDEST_TRACK * steer**2


def straight_ahead(options: SteeringOptions | None, told: Sequence[SteeringWheel | None]) -> SteeringFound:
    """Return what is known of straight ahead.

    Parameters
    ----------
    options
        Of the vehicle type; None where it says nothing of its steering.
    told
        Angles before, after and perhaps amid the exposures, None for each time at which there was none; all
        must be good and alike, and their mean counts.
    """
    if options is None:
        return NOTHING_ASKED
    fresh = [each for each in told if each is not None and each.fresh(options.oldest_s)]
    angles = [each.angle_deg for each in fresh if each.angle_deg is not None]
    wheel = wheel_u = age_s = None
    if angles and max(map(abs, angles)) <= LARGEST_BELIEVED_DEG:
        wheel = math.radians(sum(angles) / len(angles) - options.offset_deg)
        wheel_u = math.radians(options.angle_sigma_deg)
        age_s = max(each.age_s for each in fresh)
    state, why = StraightAheadState.REFUSED, _why_wrong(options, angles, wheel)
    if why is None and len(angles) < max(len(told), 1):
        why = _why_unknown(options, told)
        if not options.require_straight_ahead:
            state = StraightAheadState.NOT_CHECKED
    if why is not None or wheel is None or wheel_u is None:
        return SteeringFound(state, f"{NOT_CHECKED}: {why}", wheel, wheel_u, age_s)
    steer = wheel / options.ratio
    steer_u = math.hypot(wheel_u / options.ratio, steer * options.ratio_sigma / options.ratio)
    return SteeringFound(StraightAheadState.CHECKED, None, wheel, wheel_u, age_s, steer, steer_u)


def _why_unknown(options: SteeringOptions, told: Sequence[SteeringWheel | None]) -> str:
    """Why angles count for nothing: the vehicle type decides what follows."""
    known = [each for each in told if each is not None]
    if not known or len(known) < len(told):
        return "the line told no angle of the steering wheel"
    if not all(each.valid for each in known):
        return "the angle of the steering wheel was told as not valid"
    oldest_s = max(each.age_s for each in known)
    return f"the angle of the steering wheel is {oldest_s:.2f} s old, accepted are {options.oldest_s:g} s"


def _why_wrong(options: SteeringOptions, angles: Sequence[float], wheel: float | None) -> str | None:
    """Why toe cannot be corrected by fresh angles, degrees, if it cannot: then it is never judged."""
    if not angles:
        return None
    if wheel is None:
        return f"no steering wheel stands at {max(angles, key=abs):g}°; check what tells its angle"
    moved_deg = max(angles) - min(angles)
    # Three standard deviations of the difference of two.
    most_deg = 3.0 * math.sqrt(2.0) * options.angle_sigma_deg
    if moved_deg > most_deg:
        return (
            f"the steering wheel moved by {moved_deg:.2f}° while the wheels were measured, accepted are "
            f"{most_deg:.2f}°; hold it"
        )
    wheel_deg = math.degrees(wheel)
    if abs(wheel_deg) > options.largest_deg:
        side = "left" if wheel_deg > 0.0 else "right"
        return (
            f"the steering wheel stands {abs(wheel_deg):.2f}° to the {side} of straight, toe is corrected "
            f"from at most {options.largest_deg:g}°; turn it straight"
        )
    return None


def steering_wheel_offset(
    straight: SteeringFound, options: SteeringOptions, half_toe: float, half_toe_u: float
) -> tuple[float, float]:
    """Return how the steering wheel stands when the vehicle drives straight ahead, and its uncertainty.

    It drives along the thrust line when both front wheels have the same toe against it: from where they stand
    they turn by half the difference of their toes, and the steering wheel by the ratio times that.

    Parameters
    ----------
    straight
        Checked.
    options
        Of the vehicle type.
    half_toe, half_toe_u
        Half of left minus right front toe against the thrust line, as measured, radians: how far the front
        wheels point to the right together; and its standard uncertainty. Results are radians too.
    """
    assert straight.wheel is not None
    assert straight.wheel_u is not None
    offset = straight.wheel + options.ratio * half_toe
    u = math.hypot(straight.wheel_u, options.ratio * half_toe_u, options.ratio_sigma * half_toe)
    return offset, u
