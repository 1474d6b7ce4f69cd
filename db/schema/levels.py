"""In which table of results a quantity is, and which of its columns names the part."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from sqlalchemy import Column, Table

from db.records import QUANTITIES, Quantity
from db.schema.geometry import geometry_results
from db.schema.results import axle_results, vehicle_results, wheel_results
from db.schema.steering import steering_axis_results, steering_results

_TABLES: Mapping[str, Table] = MappingProxyType(
    {
        "wheel": wheel_results,
        "axle": axle_results,
        "vehicle": vehicle_results,
        "geometry": geometry_results,
        "steering": steering_results,
        "steering_axis": steering_axis_results,
    }
)
_PARTS: Mapping[Table, Column[Any]] = MappingProxyType(
    {
        wheel_results: wheel_results.c.wheel,
        axle_results: axle_results.c.axle,
        steering_axis_results: steering_axis_results.c.wheel,
    }
)


def results_of(quantity: str) -> Table:
    """The table that holds values of a quantity, with its uncertainty and limits in columns beside it."""
    return _TABLES[QUANTITIES[Quantity(quantity)].level]


def part_column(table: Table) -> Column[Any] | None:
    """The column that names wheel or axle; None in the tables that have one row for a vehicle."""
    return _PARTS.get(table)
