"""Where the angles of one wheel should be before a nut is locked, what brings them there, and whether it can.

Limits are narrowed by the uncertainty as in the verdict, but nothing here is one: it is where to aim.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from station.configuration import Limits
from station.guidance.drift import Drift
from station.guidance.plan import AdjusterPlan, GuidanceSettings, WheelPlan, WheelReading
from station.guidance.reaction import Reaction
from station.guidance.stillness import Rest
from station.guidance.words import AdjusterKind, OutOfReach

ROD, BOLT = AdjusterKind.TIE_ROD, AdjusterKind.CAMBER_BOLT
_LEAST_FOR_RATIO = 10.0
"""A movement of so many times what counts as one tells how camber and toe are coupled."""


@dataclass(frozen=True)
class ToTurn:
    """What a wheel needs, by the station's verdict: camber or toe turned, or both."""

    camber: bool
    toe: bool


@dataclass(frozen=True)
class Room:
    """What a verdict leaves of the limits: lowest and highest, radians; empty where low lies above high."""

    low: float
    high: float

    @classmethod
    def of(cls, limits: Limits, margin: float) -> Room:
        """Return limits narrowed to both sides."""
        return cls(limits.low + margin, limits.high - margin)

    @property
    def middle(self) -> float:
        """Farthest from both."""
        return 0.5 * (self.low + self.high)

    @property
    def half(self) -> float:
        """From the middle to each side; below 0 where nothing is left."""
        return 0.5 * (self.high - self.low)

    def holds(self, value: float) -> bool:
        """Whether a value lies inside."""
        return self.low <= value <= self.high

    def missing(self, value: float) -> float:
        """Least change that brings a value inside; 0 where it is."""
        return max(self.low - value, 0.0) + min(self.high - value, 0.0)


@dataclass
class KnownAdjuster:
    """What is known of one adjuster of this wheel by now.

    Attributes
    ----------
    reaction
        What a turn does.
    drift
        What locking usually adds.
    last_drift
        What the last locking of this nut did; None before the first.
    shift
        By which the adjuster moved its angle since it was found, radians.
    direction
        Of the last movement, +1 or -1 turns; 0 before the first.
    slack
        Turns that are added when the direction changes: the stated backlash, and half of it after each time
        that this was too much.
    odd
        Whether it moved the two angles together as on no sound axle.
    """

    reaction: Reaction
    drift: Drift
    last_drift: float | None = None
    shift: float = 0.0
    direction: int = 0
    slack: float = field(init=False)
    odd: bool = False

    def __post_init__(self) -> None:
        self.slack = self.plan.backlash_turns

    @property
    def plan(self) -> AdjusterPlan:
        """What was stated of it."""
        return self.reaction.plan

    @property
    def expected(self) -> float:
        """What locking will add, as far as a target leaves room for it."""
        return self.drift.expected(self.last_drift)


@dataclass
class Aims:
    """One wheel: what it should be, what is known of its adjusters, what its verdict leaves of the limits."""

    plan: WheelPlan
    settings: GuidanceSettings
    known: Mapping[AdjusterKind, KnownAdjuster]
    camber: Room = field(init=False)
    toe: Room = field(init=False)

    def __post_init__(self) -> None:
        self.look(0.0, 0.0)

    @classmethod
    def of(cls, plan: WheelPlan, settings: GuidanceSettings, drifts: Mapping[AdjusterKind, Drift]) -> Aims:
        """Begin with what is stated; `drifts` has one of each adjuster of the plan."""
        known = {}
        for kind in (ROD, BOLT):
            found = plan.adjuster(kind)
            if found is not None:
                known[kind] = KnownAdjuster(Reaction.stated(found), drifts[kind])
        return cls(plan, settings, known)

    def look(self, camber_u95: float, toe_u95: float) -> None:
        """Take over by how much the limits are narrowed now."""
        self.camber = Room.of(self.plan.camber, self.settings.margin * camber_u95)
        self.toe = Room.of(self.plan.toe, self.settings.margin * toe_u95)

    def window(self, kind: AdjusterKind) -> float:
        """Return how near an aim is near enough."""
        room = self.toe if kind is ROD else self.camber
        return self.settings.window * max(room.half, 0.0)

    def wanted(self, reading: WheelReading, rest: Rest, asked: frozenset[str], *, turned: bool) -> ToTurn:
        """Return what the verdict of a result, and what the axle asks of this wheel, leave to do.

        Of a wheel that was `turned` already the margin is asked too; one that was found good is left alone.
        `asked`: ``camber`` and ``toe`` where an angle of axle or vehicle is outside and this wheel is the
        farthest from its own target.
        """
        camber = not reading.verdicts[f"{self.plan.wheel}.camber"]
        toe = not reading.verdicts[f"{self.plan.wheel}.toe"]
        if turned:
            camber, toe = camber or not self.camber.holds(rest.camber), toe or not self.toe.holds(rest.toe)
        for name in ("camber", "toe"):
            kind, room = (BOLT, self.camber) if name == "camber" else (ROD, self.toe)
            away = abs(getattr(rest, name) - room.middle)
            if name in asked and kind in self.known and away > self.window(kind):
                camber, toe = camber or name == "camber", toe or name == "toe"
        return ToTurn(camber, toe)

    def choose(self, rest: Rest, wanted: ToTurn) -> AdjusterKind | OutOfReach:
        """Return what is to be turned, camber before toe, or why nothing can be.

        Where the tie rod is to be turned anyway, camber is good when it will be so afterwards.
        """
        rod, bolt = self.known.get(ROD), self.known.get(BOLT)
        if wanted.toe and rod is None:
            return OutOfReach.NO_ADJUSTER
        after = rest.camber
        if wanted.toe and rod is not None:
            after += rod.reaction.ratio * (self._toe_aim(rest) - rest.toe)
        if (wanted.camber and not wanted.toe) or not self.camber.holds(after):
            if bolt is not None:
                return BOLT
            if rod is None or self._toe_room(rest).half < 0.0:
                return OutOfReach.NO_ADJUSTER
        return ROD

    def aim(self, kind: AdjusterKind, rest: Rest, *, rod_follows: bool) -> float:
        """Return where the angle of an adjuster should be before its nut is locked.

        `rod_follows`: the tie rod is turned after the camber bolt, and will change camber once more.
        """
        if kind is ROD:
            return self._toe_aim(rest) - self.known[ROD].expected
        bolt = self.known[BOLT]
        middle = self.camber.middle - bolt.expected
        if not rod_follows:
            return middle
        # camber aim + what the rod adds on toe's way from where the bolt will have moved it = middle
        by_rod, by_bolt = self.known[ROD].reaction.ratio, bolt.reaction.ratio
        both = min(max(by_rod * by_bolt, -0.5), 0.5)
        return (middle - by_rod * (self.toe.middle - rest.toe) - both * rest.camber) / (1.0 - both)

    def bolt_before_lock(self, rest: Rest) -> bool:
        """Whether camber would be outside with the nut of the tie rod locked here, and a bolt can help.

        A turn of the rod moves camber by what nobody knew before it was turned. The bolt is turned while the
        rod's nut is loose, for it moves toe too, and toe is set once more before that nut is locked.
        """
        if ROD not in self.known or BOLT not in self.known:
            return False
        rod = self.known[ROD]
        after = rest.camber + rod.reaction.ratio * rod.expected
        inside = Room(self.camber.low + self.settings.still, self.camber.high - self.settings.still)
        if inside.half < 0.0 or inside.holds(after):
            return False
        aim = self.aim(BOLT, rest, rod_follows=True)
        return self.reach(BOLT, rest, aim) is OutOfReach.NONE and not self.at_end(BOLT, rest, aim)

    def rod_follows(self, rest: Rest, wanted: ToTurn) -> bool:
        """Whether the tie rod will have to be turned after the camber bolt."""
        if ROD not in self.known or BOLT not in self.known:
            return False
        moved = self.known[BOLT].reaction.ratio * (self.camber.middle - rest.camber)
        return wanted.toe or not self.toe.holds(rest.toe + moved)

    def turns(self, kind: AdjusterKind, away: float) -> float:
        """Return the turns that change the angle of an adjuster by `away`, those in the backlash included."""
        known = self.known[kind]
        turns = away / known.reaction.main
        sign = 1 if turns > 0.0 else -1
        return turns + (sign * known.slack if known.direction == -sign else 0.0)

    def reach(self, kind: AdjusterKind, rest: Rest, aim: float) -> OutOfReach:
        """Say why the angle cannot come inside its limits by this adjuster; NONE where it may.

        Only what the largest believable reaction cannot do is beyond the range.
        """
        known = self.known[kind]
        if known.odd:
            return OutOfReach.REACTION
        least = self._least(kind, rest, aim)
        beyond = abs(known.shift + least) > known.reaction.most * known.plan.range_turns
        return OutOfReach.RANGE if least != 0.0 and beyond else OutOfReach.NONE

    def at_end(self, kind: AdjusterKind, rest: Rest, aim: float) -> bool:
        """Whether the adjuster may be at the end of its range, and its aim lies beyond it."""
        known, plan = self.known[kind], self.known[kind].plan
        away = aim - (rest.toe if kind is ROD else rest.camber)
        smallest = abs(plan.main) * (1.0 - plan.error) * max(plan.range_turns - plan.backlash_turns, 0.0)
        return away * known.shift > 0.0 and abs(known.shift) >= smallest - self.settings.still

    def enough(self, kind: AdjusterKind, rest: Rest, aim: float) -> bool:
        """Whether a nut locked here, short of its aim, is expected to leave its angle inside all the same."""
        return self._least(kind, rest, aim) == 0.0

    def moved(self, kind: AdjusterKind, before: Rest, after: Rest, told: float, aim: float) -> None:
        """Learn from a movement from rest to rest while `told` turns of an adjuster were to be turned."""
        known = self.known[kind]
        camber, toe = after.camber - before.camber, after.toe - before.toe
        change = np.array([toe, camber] if kind is ROD else [camber, toe])
        if abs(change[0]) <= self.settings.still or self._other_turned(kind, change):
            return
        known.shift += float(change[0])
        sign = 1 if change[0] * known.plan.main > 0.0 else -1
        free = known.slack if known.direction == -sign else 0.0
        known.direction = sign
        if abs(change[0]) >= _LEAST_FOR_RATIO * self.settings.still:
            apart = change[1] / change[0] - known.plan.across / known.plan.main
            known.odd = bool(abs(apart) > known.plan.coupling_error)
        turns = told - sign * free
        beyond = (after.toe if kind is ROD else after.camber) - aim
        missed = abs(beyond) > self.window(kind)
        if free and missed and beyond * change[0] > 0.0:
            known.slack *= 0.5
        obeyed = missed and told * sign > 0.0 and turns * sign > 0.0
        if obeyed and known.reaction.believable(turns, change):
            turns_u = float(np.hypot(self.settings.turning_error * turns, 0.5 * known.plan.backlash_turns))
        else:
            # Stopped where the values said so, or amid a turn: it tells how the angles go together, no more.
            turns = float(change[0]) / known.reaction.main
            turns_u = 3.0 * abs(turns)
        known.reaction = known.reaction.after(turns, turns_u, change, 0.5 * self.settings.still)

    def _other_turned(self, kind: AdjusterKind, change: np.ndarray) -> bool:
        """Whether both angles moved as the other adjuster moves them: somebody turned that one."""
        other = self.known.get(BOLT if kind is ROD else ROD)
        if other is None or abs(change[1]) <= self.settings.still:
            return False
        return bool(
            abs(change[0]) < abs(change[1])
            and abs(change[0] / change[1] - other.reaction.ratio) <= 0.5 * other.plan.coupling_error
        )

    def _least(self, kind: AdjusterKind, rest: Rest, aim: float) -> float:
        """Least change of the adjuster's angle that brings it inside, seen from its aim."""
        room, value = (self.toe, rest.toe) if kind is ROD else (self.camber, rest.camber)
        shift = aim + self.known[kind].expected - room.middle
        return Room(room.low + shift, room.high + shift).missing(value)

    def _toe_aim(self, rest: Rest) -> float:
        """Middle of the limits; where camber has no adjuster, near enough to it that camber is inside too."""
        room = self._toe_room(rest)
        inside = room.low + self.window(ROD) <= self.toe.middle <= room.high - self.window(ROD)
        return self.toe.middle if inside or room.half < 0.0 else room.middle

    def _toe_room(self, rest: Rest) -> Room:
        """Toes at which camber is inside as well, where the tie rod alone changes both."""
        if BOLT in self.known or ROD not in self.known:
            return self.toe
        ratio = self.known[ROD].reaction.ratio
        if abs(ratio) * self.toe.half * 2.0 < self.settings.still:
            return self.toe if self.camber.holds(rest.camber) else Room(self.toe.high, self.toe.low)
        ends = sorted(rest.toe + (edge - rest.camber) / ratio for edge in (self.camber.low, self.camber.high))
        return Room(max(self.toe.low, ends[0]), min(self.toe.high, ends[1]))
