"""What locking the nuts of each vehicle type usually adds on this station, from vehicle to vehicle."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence

from alignment.errors import StoreError
from db.records import AdjustingRecord
from station.cycle.judging import axle_of
from station.cycle.modes.adjusting_record import adjusting_records
from station.cycle.modes.guiding import Drifts, Guiding, stated_drifts
from station.cycle.under_way import CycleUnderWay
from station.guidance import AdjusterKind

_LOG = logging.getLogger("truewheel.station")
_ASKED = 240
"""Stored adjusters that a program begins with: as many nuts as are remembered, of four kinds of them."""
Stored = Callable[[str, int], Sequence[AdjustingRecord]]
"""The last so many adjusters with a locked nut, newest first, of the vehicle type of this name."""


class LearnedDrifts:
    """What was learned so far, by vehicle type; a program begins with what was stored before it.

    Parameters
    ----------
    stored
        Asked once of each vehicle type, when its first vehicle is adjusted.
    """

    def __init__(self, stored: Stored) -> None:
        self._stored = stored
        self._of_type: dict[int, Drifts] = {}

    def guiding(self, cycle: CycleUnderWay) -> Guiding | None:
        """Begin to guide an adjusting; None where the vehicle type names no adjuster."""
        kind = cycle.kind
        assert kind is not None
        if not kind.adjusting:
            return None
        if kind.number not in self._of_type:
            self._of_type[kind.number] = learned_from(stated_drifts(kind), self._before(kind.name))
        return Guiding(kind, cycle.trigger.wheels, self._of_type[kind.number])

    def learn(self, cycle: CycleUnderWay, guiding: Guiding | None) -> tuple[str, ...]:
        """Take over what an adjusting told, however it ended; return what to say of each turned wheel.

        The cycle's record has the same in numbers.
        """
        if guiding is None or cycle.kind is None:
            return ()
        number = cycle.kind.number
        self._of_type[number] = guiding.learned(self._of_type[number])
        cycle.adjusted = adjusting_records(guiding, cycle.trigger.received_s)
        return tuple(guiding.account())

    def _before(self, name: str) -> Sequence[AdjustingRecord]:
        try:
            return self._stored(name, _ASKED)
        except StoreError as error:
            # Without it targets are a little less good; the verdict is the same.
            _LOG.warning("what locking adds on %s is learned anew: %s", name, error)
            return ()


def learned_from(drifts: Drifts, stored: Iterable[AdjustingRecord]) -> Drifts:
    """Return what is known of locking after stored adjustings, given newest first.

    The mean of several nuts of one adjuster counts as often as there are nuts behind it. Of adjusters that
    the vehicle type does not name any more nothing is learned.
    """
    found = dict(drifts)
    for record in reversed(tuple(stored)):
        key = axle_of(record.wheel), AdjusterKind(record.adjuster)
        if record.drift is None or key not in found:
            continue
        for _ in range(record.nuts_locked):
            found[key] = found[key].after(record.drift)
    return found
