"""A wheel that is adjusted on paper: angles in arcminutes go in, advice comes out."""

from __future__ import annotations

from station.configuration.limits import Limits
from station.guidance.drift import Drift
from station.guidance.plan import AdjusterPlan, GuidanceSettings, WheelPlan, WheelReading
from station.guidance.wheel import Advice, WheelGuide
from station.guidance.words import AdjusterKind, GuidanceState

ARCMIN = 3.141592653589793 / 10800.0
ROD, BOLT = AdjusterKind.TIE_ROD, AdjusterKind.CAMBER_BOLT
SIX = Limits(-6.0 * ARCMIN, 6.0 * ARCMIN)
STEP_S = 0.25


def rod(main: float = 40.0, across: float = 0.0, turns: float = 4.0, backlash: float = 0.0) -> AdjusterPlan:
    return AdjusterPlan(ROD, main * ARCMIN, across * ARCMIN, 0.3, 0.3, turns, backlash)


def bolt(main: float = 30.0, across: float = 0.0, turns: float = 4.0, backlash: float = 0.0) -> AdjusterPlan:
    return AdjusterPlan(BOLT, main * ARCMIN, across * ARCMIN, 0.3, 0.3, turns, backlash)


class Walk:
    """One wheel, `front_left`, limits ±6′ for both angles, narrowed by `u95`′."""

    def __init__(
        self,
        *,
        with_rod: AdjusterPlan | None = None,
        with_bolt: AdjusterPlan | None = None,
        drift: Drift | None = None,
        u95: float = 0.5,
        settings: GuidanceSettings | None = None,
    ) -> None:
        plan = WheelPlan("front_left", SIX, SIX, with_rod, with_bolt)
        drift = drift or Drift(0.0, 9.0 * ARCMIN)
        self.guide = WheelGuide(plan, {ROD: drift, BOLT: drift}, settings)
        self.u95 = u95
        self.time_s = 100.0
        self.allowed = True
        self.asked: frozenset[str] = frozenset()
        self.verdicts: dict[str, bool] = {}
        self.whole = True
        self.seen: list[GuidanceState] = []

    def at(self, camber: float, toe: float, times: int = 1) -> Advice:
        """So many results, the verdict as the station's: inside the limits narrowed by the uncertainty."""
        assert times > 0
        for _ in range(times):
            self.time_s += STEP_S
            inside = {
                "front_left.camber": abs(camber) <= 6.0 - self.u95,
                "front_left.toe": abs(toe) <= 6.0 - self.u95,
            }
            u95 = self.u95 * ARCMIN
            reading = WheelReading(
                "front_left",
                self.time_s,
                camber * ARCMIN,
                toe * ARCMIN,
                u95,
                u95,
                inside | self.verdicts,
                whole=self.whole,
            )
            advice = self.guide.take(reading, allowed=self.allowed, asked=self.asked)
            if not self.seen or self.seen[-1] is not advice.state:
                self.seen.append(advice.state)
        return advice

    def lost(self) -> Advice:
        self.time_s += STEP_S
        return self.guide.take(WheelReading("front_left", self.time_s))
