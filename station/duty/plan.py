"""When a master check is asked for, and how long before the station warns."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta
from zoneinfo import ZoneInfo

from alignment.errors import InputError
from station.duty.words import DEMANDS, DutyEvent

_DEMANDED = frozenset(DEMANDS.values())


@dataclass(frozen=True)
class DutyPlan:
    """What a station's configuration says of master checks; nothing asked means that none is required.

    Attributes
    ----------
    vehicles
        A check after so many vehicles of a rig.
    every
        A check after so much time.
    shift_starts, zone
        A check at these times of day, by the plant's clock.
    after
        A check after these events.
    warn_vehicles, warn
        The station warns when no more vehicles or time than this are left.
    """

    vehicles: int | None = None
    every: timedelta | None = None
    shift_starts: tuple[time, ...] = ()
    zone: str = "UTC"
    after: frozenset[DutyEvent] = frozenset()
    warn_vehicles: int = 0
    warn: timedelta = timedelta(0)

    def __post_init__(self) -> None:
        if not self.after <= _DEMANDED:
            wrong = ", ".join(sorted(self.after - _DEMANDED))
            raise InputError(field="after", expected=", ".join(sorted(_DEMANDED)), seen=wrong)

    @property
    def required(self) -> bool:
        """Whether a check is ever asked for."""
        return bool(self.vehicles or self.every or self.shift_starts or self.after)

    def due_utc(self, good_utc: datetime) -> datetime | None:
        """When the check after a good one is due at the latest; None when no time is asked for."""
        times = [] if self.every is None else [good_utc + self.every]
        shift = self.shift_after(good_utc)
        times += [] if shift is None else [shift]
        return min(times, default=None)

    def shift_after(self, utc: datetime) -> datetime | None:
        """The first start of a shift after a time, UTC; None where there are none.

        A time that the plant's clock leaves out in spring is the one an hour later; one that it shows
        twice in autumn is the first.
        """
        zone = ZoneInfo(self.zone)
        today = utc.astimezone(zone).date()
        # Yesterday too: a date and the time of the zone may differ by the hour that was left out.
        days = [today + timedelta(days=n) for n in (-1, 0, 1, 2)]
        starts = [
            datetime.combine(day, start, zone).astimezone(UTC) for day in days for start in self.shift_starts
        ]
        return min((start for start in starts if start > utc), default=None)
