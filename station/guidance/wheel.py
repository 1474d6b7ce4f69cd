"""The guidance of one wheel: from result to result, through the states of `GUIDANCE_STATES`.

One correction is loosen, turn, lock: it begins with TURN and ends with the verdict on the locked wheel.
Nobody tells when a nut is loosened, turned or locked; it is seen by what the angles do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from station.guidance.aims import BOLT, ROD, Aims
from station.guidance.drift import Drift
from station.guidance.plan import GuidanceSettings, WheelPlan, WheelReading
from station.guidance.stillness import Rest, Stillness
from station.guidance.words import AdjusterKind, GuidanceState, OutOfReach

_TURNING = (GuidanceState.TURN, GuidanceState.HOLD)
_KEPT = 32
"""Corrections of one wheel that are accounted for; more are counted and not described."""
_RELEASED = 1.5
"""How many windows away from the aim a wheel that was held must be turned again."""
_NO_LOCK = 2.0
"""A movement of more than so many times the drift's bound is no locking: it was turned."""


@dataclass(frozen=True)
class Advice:
    """What to do at a wheel now.

    Attributes
    ----------
    state, adjuster, reason
        As in `GUIDANCE_STATES`; adjuster and reason NONE where there is none.
    turns
        To go, None unless the state is TURN or HOLD; positive lengthens, or leans the top outboard.
    camber, toe
        Targets before the nut is locked, radians.
    drift
        What locking is expected to add, radians; None where nothing is turned.
    """

    state: GuidanceState
    adjuster: AdjusterKind = AdjusterKind.NONE
    turns: float | None = None
    camber: float | None = None
    toe: float | None = None
    drift: float | None = None
    reason: OutOfReach = OutOfReach.NONE


@dataclass(frozen=True)
class NutCorrection:
    """One loosen, turn and lock of one adjuster.

    Attributes
    ----------
    turns
        As far as the movement tells, by what is known of a turn now.
    taken, locked
        The adjuster's own angle before and after the nut was locked, radians; None where it came not so far.
    """

    adjuster: AdjusterKind
    turns: float
    taken: float | None = None
    locked: float | None = None


@dataclass(frozen=True)
class _LeftLoose:
    """A tie rod whose nut stays loose until the camber bolt is set.

    Attributes
    ----------
    begun
        Where the wheel rested before the rod was turned.
    correction
        As far as it came.
    """

    begun: Rest
    correction: NutCorrection


class WheelGuide:
    """Guides whoever adjusts one wheel.

    Parameters
    ----------
    plan
        Its limits and adjusters.
    drifts
        What locking usually adds, of each of its adjusters.
    settings
        When it rests.

    Attributes
    ----------
    found
        Where it was before anything was turned; None until it rested.
    corrections
        So far, the last one with what is known of it by now.
    """

    def __init__(
        self,
        plan: WheelPlan,
        drifts: Mapping[AdjusterKind, Drift],
        settings: GuidanceSettings | None = None,
    ) -> None:
        self.plan = plan
        self._settings = settings or GuidanceSettings()
        self._aims = Aims.of(plan, self._settings, drifts)
        self._still = Stillness(self._settings)
        self._state = GuidanceState.CHECK
        self._resume = GuidanceState.CHECK
        self._kind = AdjusterKind.NONE
        self._reason = OutOfReach.NONE
        self._rod_follows = self._idle = self._ended = False
        self._anchor: Rest | None = None
        self._begun: Rest | None = None
        self._told = self._short = 0.0
        self._at_end: set[AdjusterKind] = set()
        self._since_s = 0.0
        self._good = 0
        self._judged = 0
        self._taken: float | None = None
        self._locked: float | None = None
        self._seen = False
        self.found: Rest | None = None
        self._closed: list[NutCorrection] = []
        self._loose: _LeftLoose | None = None
        self.count = 0

    @property
    def state(self) -> GuidanceState:
        """Where its adjusting stands; NONE before the first result."""
        return self._state if self._seen else GuidanceState.NONE

    @property
    def reason(self) -> OutOfReach:
        """Why it cannot be adjusted; NONE unless it is unreachable."""
        return self._reason if self.state is GuidanceState.UNREACHABLE else OutOfReach.NONE

    @property
    def finished(self) -> bool:
        """Whether others need not wait for it: it is done, or nothing that is turned here can help."""
        return self.state in (GuidanceState.DONE, GuidanceState.UNREACHABLE) or self._idle

    @property
    def corrections(self) -> tuple[NutCorrection, ...]:
        """So far; the last one with what is known of it by now."""
        open_ones = [] if self._loose is None else [self._loose.correction]
        if self._kind is not AdjusterKind.NONE and self._begun is not None:
            open_ones.append(self._correction())
        return (*self._closed, *open_ones)

    def take(
        self, reading: WheelReading, *, allowed: bool = True, asked: frozenset[str] = frozenset()
    ) -> Advice:
        """Return what to do after a result.

        Parameters
        ----------
        reading
            Of this wheel.
        allowed
            Whether a correction may begin: no wheel before it in the order needs one.
        asked
            See `Aims.wanted`.
        """
        if reading.camber is None or reading.toe is None:
            self._lose()
            return self._advice(None)
        self._seen = True
        if self._state is GuidanceState.LOST:
            self._state, self._since_s = self._resume, reading.time_s
        self._still.take(reading.time_s, reading.camber, reading.toe)
        self._aims.look(reading.camber_u95, reading.toe_u95)
        now, rest = Rest(reading.camber, reading.toe), self._still.rest
        self._count(reading, asked)
        match self._state:
            case GuidanceState.TURN | GuidanceState.HOLD:
                self._turn(reading.time_s, now, rest)
            case GuidanceState.UNREACHABLE if self._ended:
                self._free(reading.time_s, rest)
            case GuidanceState.LOCK_NUT:
                self._lock(reading.time_s, rest)
            case GuidanceState.DONE if not self._inside(reading):
                self._check(reading.time_s)
            case GuidanceState.DONE:
                self._locked = self._main(rest) if rest is not None else self._locked
            case _:
                self._decide(reading, rest, allowed=allowed, asked=asked)
        return self._advice(now)

    def _lose(self) -> None:
        if not self._seen:
            return
        if self._state is not GuidanceState.LOST:
            self._resume = {
                GuidanceState.TURN: GuidanceState.TURN,
                GuidanceState.HOLD: GuidanceState.TURN,
                GuidanceState.LOCK_NUT: GuidanceState.LOCK_NUT,
            }.get(self._state, GuidanceState.CHECK)
        self._state, self._reason = GuidanceState.LOST, OutOfReach.NONE
        self._good = self._judged = 0
        self._idle = self._ended = False
        self._still.clear()

    def _inside(self, reading: WheelReading) -> bool:
        return reading.whole and self._own(reading) and all(reading.verdicts.values())

    def _own(self, reading: WheelReading) -> bool:
        """Whether the wheel's own angles were judged."""
        return {f"{self.plan.wheel}.camber", f"{self.plan.wheel}.toe"} <= reading.verdicts.keys()

    def _count(self, reading: WheelReading, asked: frozenset[str]) -> None:
        """Count results in a row: those that were judged, and those of them that are inside."""
        self._judged = self._judged + 1 if self._own(reading) else 0
        self._good = self._good + 1 if self._inside(reading) and not asked else 0

    def _check(self, time_s: float) -> None:
        self._state, self._since_s, self._reason = GuidanceState.CHECK, time_s, OutOfReach.NONE
        self._good = self._judged = 0
        self._idle = self._ended = False
        self._still.clear()

    def _decide(
        self, reading: WheelReading, rest: Rest | None, *, allowed: bool, asked: frozenset[str]
    ) -> None:
        """Judge a wheel at rest: done, turned (again), or out of reach."""
        self._idle = False
        if rest is None or self._judged < self._settings.readings:
            if self._state is not GuidanceState.WAITING and rest is None:
                self._state, self._reason = GuidanceState.CHECK, OutOfReach.NONE
            return
        self.found = self.found or rest
        if self._state is GuidanceState.CHECK and self._taken is not None:
            self._locked = self._main(rest)
        if self._loose is not None:
            self._lock_rod(self._loose, rest, reading.time_s)
            return
        wanted = self._aims.wanted(reading, rest, asked, turned=self.count > 0)
        if self._good >= self._settings.readings and not (wanted.camber or wanted.toe):
            self._state, self._reason = GuidanceState.DONE, OutOfReach.NONE
            return
        if not (wanted.camber or wanted.toe):
            # Inside now and then, which more results decide; or outside by the other wheels of its axle.
            self._idle = self._good == 0
            self._state = GuidanceState.WAITING if self._idle else GuidanceState.CHECK
            self._reason = OutOfReach.NONE
            return
        reason = chosen = self._aims.choose(rest, wanted)
        follows = self._aims.rod_follows(rest, wanted)
        if isinstance(chosen, AdjusterKind):
            self._close()
            reason = self._aims.reach(chosen, rest, self._aims.aim(chosen, rest, rod_follows=follows))
        if isinstance(reason, OutOfReach) and reason is not OutOfReach.NONE:
            self._state, self._reason = GuidanceState.UNREACHABLE, reason
        elif not allowed:
            self._state, self._reason = GuidanceState.WAITING, OutOfReach.NONE
        else:
            assert isinstance(chosen, AdjusterKind)
            self._rod_follows = follows
            self.count += 1
            self._begin(chosen, rest, rest, reading.time_s)

    def _begin(self, kind: AdjusterKind, begun: Rest, rest: Rest, time_s: float) -> None:
        """Have an adjuster turned, in a correction that began at `begun`."""
        self._kind, self._begun, self._taken, self._locked = kind, begun, None, None
        self._state, self._reason = GuidanceState.TURN, OutOfReach.NONE
        self._short = 0.0
        self._rest_at(rest, time_s)
        # What was at rest before anything was turned says nothing of where to lock.
        self._still.clear()

    def _leave_loose(self, rest: Rest, time_s: float) -> None:
        """Have the camber bolt turned before the tie rod's nut is locked."""
        assert self._begun is not None
        self._loose = _LeftLoose(self._begun, self._correction())
        self._rod_follows = True
        self.count += 1
        self._begin(BOLT, rest, rest, time_s)

    def _lock_rod(self, loose: _LeftLoose, rest: Rest, time_s: float) -> None:
        """Go on with a tie rod whose nut is loose: toe is set once more, and the nut locked in any case."""
        self._close()
        self._loose = None
        self._begin(ROD, loose.begun, rest, time_s)

    def _free(self, time_s: float, rest: Rest | None) -> None:
        """Look whether an adjuster that was at its end moves on, or the wheel came inside."""
        if self._good >= self._settings.readings:
            self._check(time_s)
        elif rest is not None and self._moved(rest):
            self._state, self._reason, self._ended = GuidanceState.TURN, OutOfReach.NONE, False
            self._turn(time_s, rest, rest)

    def _close(self) -> None:
        """End a correction: what its locking added is that nut's."""
        if self._kind is AdjusterKind.NONE or self._begun is None:
            return
        done = self._correction()
        if done.taken is not None and done.locked is not None:
            self._aims.known[self._kind].last_drift = done.locked - done.taken
        if len(self._closed) < _KEPT:
            self._closed.append(done)
        self._begun = None

    def _correction(self) -> NutCorrection:
        assert self._begun is not None
        end = self._taken if self._taken is not None else self._main(self._anchor or self._begun)
        turns = (end - self._main(self._begun)) / self._aims.known[self._kind].reaction.main
        return NutCorrection(self._kind, turns, self._taken, self._locked)

    def _rest_at(self, rest: Rest, time_s: float) -> None:
        """Remember where a turn begins, and what is told of it."""
        self._anchor, self._since_s = rest, time_s
        self._told = self._aims.turns(self._kind, self._aim(rest) - self._main(rest))

    def _moved(self, rest: Rest) -> bool:
        assert self._anchor is not None
        moved = max(abs(rest.camber - self._anchor.camber), abs(rest.toe - self._anchor.toe))
        return moved > self._settings.still

    def _turn(self, time_s: float, now: Rest, rest: Rest | None) -> None:
        away = abs(self._aim(now) - self._main(now))
        window = max(self._aims.window(self._kind), self._short)
        if away <= window and self._state is GuidanceState.TURN:
            # Whoever turns may not have seen it yet: only what rests from here on is at rest.
            self._state = GuidanceState.HOLD
            self._still.clear()
            return
        if away > _RELEASED * window or self._state is GuidanceState.TURN:
            self._state = GuidanceState.TURN
        if rest is None:
            return
        assert self._anchor is not None
        if self._moved(rest):
            self._aims.moved(self._kind, self._anchor, rest, self._told, self._aim(rest))
            self._rest_at(rest, time_s)
        if self._state is GuidanceState.HOLD:
            if abs(self._aim(rest) - self._main(rest)) <= _RELEASED * window:
                if self._kind is ROD and self._aims.bolt_before_lock(rest):
                    self._leave_loose(rest, time_s)
                    return
                self._state, self._since_s = GuidanceState.LOCK_NUT, time_s
                self._anchor, self._taken = rest, self._main(rest)
            return
        aim, rested_s = self._aim(rest), time_s - self._since_s
        reason = self._aims.reach(self._kind, rest, aim)
        if rested_s >= self._settings.stuck_s and self._aims.at_end(self._kind, rest, aim):
            reason = self._end(rest, aim)
        if reason is not OutOfReach.NONE:
            self._state, self._reason, self._ended = GuidanceState.UNREACHABLE, reason, True
        elif self._good >= self._settings.readings and rested_s >= self._settings.lock_s:
            # Left alone inside its limits: somebody found that good enough.
            self._check(time_s)

    def _end(self, rest: Rest, aim: float) -> OutOfReach:
        """Judge an adjuster at its end: what is short of its aim and still enough is locked there, once."""
        if self._kind in self._at_end or not self._aims.enough(self._kind, rest, aim):
            return OutOfReach.RANGE
        self._at_end.add(self._kind)
        self._short = abs(aim - self._main(rest)) + self._settings.still
        return OutOfReach.NONE

    def _lock(self, time_s: float, rest: Rest | None) -> None:
        assert self._taken is not None
        if rest is None:
            return
        moved = abs(self._main(rest) - self._taken)
        if moved > max(
            _NO_LOCK * self._aims.known[self._kind].drift.bound, 2.0 * self._aims.window(self._kind)
        ):
            # Far more than locking does: turned again.
            self._state, self._taken = GuidanceState.TURN, None
            self._turn(time_s, rest, rest)
        elif moved > self._settings.still or time_s - self._since_s >= self._settings.lock_s:
            self._check(time_s)

    def _aim(self, now: Rest) -> float:
        return self._aims.aim(self._kind, now, rod_follows=self._rod_follows and self._kind is BOLT)

    def _main(self, rest: Rest) -> float:
        return rest.toe if self._kind is ROD else rest.camber

    def _advice(self, now: Rest | None) -> Advice:
        """Say what is known now; `now` is None where the wheel was not seen."""
        state, kind = self.state, self._kind
        active = state in (*_TURNING, GuidanceState.LOCK_NUT)
        if now is None or kind is AdjusterKind.NONE or not active:
            return Advice(state, reason=self._reason)
        aim, known = self._aim(now), self._aims.known[kind]
        turns = self._aims.turns(kind, aim - self._main(now)) if state in _TURNING else None
        camber, toe = (None, aim) if kind is ROD else (aim, None)
        return Advice(state, kind, turns, camber, toe, known.expected)
