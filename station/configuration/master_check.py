"""When the station asks for a master check; without the table it never does."""

from __future__ import annotations

from datetime import time
from typing import Annotated, Literal
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import AfterValidator, Field, model_validator

from alignment.errors import DegenerateInputError
from sensors.formats import StrictModel


def _time_of_day(text: str) -> str:
    time.fromisoformat(text)
    return text


TimeOfDay = Annotated[str, Field(pattern=r"^([01]\d|2[0-3]):[0-5]\d$"), AfterValidator(_time_of_day)]
Asking = Literal["fault", "restart", "camera", "calibration"]


class MasterCheckOptions(StrictModel):
    """When a check with a master is due. Overdue or failed, no vehicle is measured before a good one."""

    every_vehicles: int | None = Field(
        default=None, ge=1, le=1_000_000, description="A check after so many vehicles of a rig; none without"
    )
    every_hours: float | None = Field(
        default=None, gt=0, le=8760, description="A check after so many hours; none without"
    )
    shift_starts: tuple[TimeOfDay, ...] = Field(
        default=(), max_length=24, description="A check at these times of every day, such as '06:00'"
    )
    timezone: str = Field(
        default="UTC", min_length=1, max_length=60, description="Zone of these times, such as Europe/Berlin"
    )
    after: tuple[Asking, ...] = Field(
        default=(),
        max_length=4,
        description="A check after each fault, restart of the program, camera that was reached anew, new"
        " calibration of a rig",
    )
    warn_before_vehicles: int = Field(
        default=0, ge=0, le=100_000, description="Warn when no more vehicles than this are left"
    )
    warn_before_minutes: float = Field(
        default=0.0, ge=0, le=10_080, description="Warn when no more minutes than this are left"
    )

    @model_validator(mode="after")
    def _is_possible(self) -> MasterCheckOptions:
        asked = (self.every_vehicles, self.every_hours, self.shift_starts, self.after)
        if not any(asked):
            raise DegenerateInputError(
                field="master_check",
                expected="one of every_vehicles, every_hours, shift_starts, after at least",
                seen="none of them",
                cure="Say when a check is due, or leave the table out",
            )
        for field, values in (("shift_starts", self.shift_starts), ("after", self.after)):
            if len(set(values)) < len(values):
                raise DegenerateInputError(field=field, expected="each of them once", seen=", ".join(values))
        self._check_zone()
        self._check_warning(
            "warn_before_vehicles", self.warn_before_vehicles, "every_vehicles", self.every_vehicles
        )
        minutes = None if self.every_hours is None else 60.0 * self.every_hours
        if not self.shift_starts:
            self._check_warning("warn_before_minutes", self.warn_before_minutes, "every_hours", minutes)
        return self

    def _check_zone(self) -> None:
        try:
            ZoneInfo(self.timezone)
        except (ZoneInfoNotFoundError, ValueError, OSError) as error:
            raise DegenerateInputError(
                field="timezone", expected="a name such as Europe/Berlin", seen=ascii(self.timezone)
            ) from error

    def _check_warning(self, name: str, before: float, asked: str, every: float | None) -> None:
        """Refuse a warning that would never come, or never end."""
        if before and every is None:
            raise DegenerateInputError(
                field=name, expected=f"none without {asked}", seen=f"{before:g}", cure=f"Say {asked} too"
            )
        if every is not None and before >= every:
            raise DegenerateInputError(
                field=name, expected=f"less than {asked}, {every:g}", seen=f"{before:g}",
                cure="Warn later, or the station warns all the time",
            )  # fmt: skip
