"""What locking the nuts of each vehicle type usually adds on this station, from vehicle to vehicle."""

from __future__ import annotations

from station.cycle.adjusting_record import adjusting_records
from station.cycle.guiding import Drifts, Guiding, stated_drifts
from station.cycle.under_way import CycleUnderWay


class LearnedDrifts:
    """What was learned since the program began, by vehicle type."""

    def __init__(self) -> None:
        self._of_type: dict[int, Drifts] = {}

    def guiding(self, cycle: CycleUnderWay) -> Guiding | None:
        """Begin to guide an adjusting; None where the vehicle type names no adjuster."""
        assert cycle.kind is not None
        if not cycle.kind.adjusting:
            return None
        drifts = self._of_type.setdefault(cycle.kind.number, stated_drifts(cycle.kind))
        return Guiding(cycle.kind, cycle.trigger.wheels, drifts)

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
