"""Is a figure of a camera still good? By the configuration, and by its first shots after the calibration."""

from __future__ import annotations

from dataclasses import dataclass

from station.configuration import HealthOptions
from station.health.figures import Figure

COMPARED = frozenset({Figure.LINK, Figure.WIDTH, Figure.LIGHT, Figure.ROW})
"""Figures that are compared with those of the first shots."""
LEAST_FIRST = 20
"""First shots before anything is compared with them."""
_BACK = 0.9
"""Share of the way to its limit at which a figure is good again."""


@dataclass(frozen=True)
class Judged:
    """How far a figure is on the way to its limit, 1 at the limit, and what to say and do about it."""

    reached: float
    text: str
    cure: str

    @property
    def beyond(self) -> bool:
        """Whether to warn."""
        return self.reached > 1.0

    @property
    def good(self) -> bool:
        """Whether a warning is over: clearly, so that it does not come and go."""
        return self.reached < _BACK


class HealthLimits:
    """Judges figures; `stop` takes the limits that stop a wheel instead of those that warn.

    Parameters
    ----------
    options
        Of the configuration.
    stop
        Which limits.
    """

    def __init__(self, options: HealthOptions, *, stop: bool = False) -> None:
        self._options = options
        self._stop = stop

    def _limit(self, name: str, unit: str) -> float | None:
        found: float | None = getattr(self._options, f"{name}_{'stop' if self._stop else 'warn'}_{unit}")
        return found

    def judged(self, figure: Figure, value: float, first: float | None) -> Judged | None:
        """Judge a value; None where there is no limit, or nothing to compare with.

        Parameters
        ----------
        figure
            What it is.
        value
            Of failures: among the last hundred shots; else of one shot, or the mean of some.
        first
            Mean of the first shots; of the link its fastest.
        """
        if figure is Figure.TEMPERATURE:
            return self._temperature(value)
        if figure is Figure.FAILURES:
            return None if self._stop else self._failures(value)
        if first is None:
            return None
        if figure is Figure.LINK:
            return None if self._stop or first <= 0.0 else self._link(value, first)
        if figure is Figure.ROW:
            return self._row(value, first)
        return self._ratio(figure, value, first)

    def _temperature(self, value: float) -> Judged | None:
        limit = self._limit("temperature", "c")
        if limit is None:
            return None
        # Degrees have no natural zero here: ten of them are the way to the limit.
        reached = 1.0 + (value - limit) / 30.0
        return Judged(
            reached, f"{value:.0f} °C, at most {limit:g} °C is well",
            "Check the fan, the air around the head, and the exposure's duty",
        )  # fmt: skip

    def _failures(self, value: float) -> Judged:
        limit = self._options.failures_warn
        # So many are too many; one less is good again.
        return Judged(
            value / (limit - 0.5), f"{value:.0f} of its last 100 shots failed",
            "Check its cable, its plugs and the load of its link",
        )  # fmt: skip

    def _link(self, value: float, fastest: float) -> Judged:
        most = max(1.0 - self._options.link_warn_share, 1e-3) * fastest
        return Judged(
            (fastest - value) / most, f"its link runs at {value:.0f} Mbit/s, it did at {fastest:.0f}",
            "Check its cable, its plugs and the port of the switch",
        )  # fmt: skip

    def _row(self, value: float, first: float) -> Judged | None:
        limit = self._limit("row", "px")
        if limit is None:
            return None
        return Judged(
            (value - first) / limit,
            f"its head's epipolar residual is {value:.2f} px, it was {first:.2f} px after the calibration",
            "A camera moved a little: check the head's screws, and check the calibration",
        )

    def _ratio(self, figure: Figure, value: float, first: float) -> Judged | None:
        limit = self._limit("width" if figure is Figure.WIDTH else "light", "ratio")
        if limit is None or value <= 0.0 or first <= 0.0:
            return None
        ratio = value / first
        if figure is Figure.WIDTH:
            return Judged(
                (ratio - 1.0) / (limit - 1.0),
                f"the light lines are {ratio:.2f} times as wide as after the calibration",
                "Check its focus, the projector's, and the windows for dirt",
            )
        worst = max(ratio, 1.0 / ratio)
        how = f"{ratio:.2f} times as bright" if ratio > 1.0 else f"only {ratio:.0%} as bright"
        return Judged(
            (worst - 1.0) / (limit - 1.0),
            f"the light lines are {how} as after the calibration",
            "Check exposure and gain" if ratio > 1.0 else "Clean the windows; check projector and exposure",
        )
