"""Sums of results, kept up to date beside them, which make reports of months fast."""

from db.sums.partial import (
    CATEGORY,
    CHARACTERISTIC,
    SUMS,
    Selection,
    counted,
    epoch_hour,
    hourly,
    hours_of,
    merged_sums,
    raw_outcomes,
    raw_values,
)
from db.sums.update import bring_up_to_date, check_sums, forget_sums, update_sums

__all__ = [
    "CATEGORY",
    "CHARACTERISTIC",
    "SUMS",
    "Selection",
    "bring_up_to_date",
    "check_sums",
    "counted",
    "epoch_hour",
    "forget_sums",
    "hourly",
    "hours_of",
    "merged_sums",
    "raw_outcomes",
    "raw_values",
    "update_sums",
]
