"""How cameras were, per hour and day: figures that drift for months before a measurement is refused.

They belong to the station alone: not shipped, not chained, thinned with age, so that a camera takes a bounded
number of rows however long it runs.
"""

from __future__ import annotations

from sqlalchemy import Column, Double, ForeignKey, Integer, PrimaryKeyConstraint, SmallInteger, Table, Text

from db.schema.base import check, metadata
from db.schema.plant import stations

camera_history = Table(
    "camera_history",
    metadata,
    Column("station_id", ForeignKey(stations.c.id), nullable=False),
    # Name of the camera: front_left/head_2/right.
    Column("camera", Text, nullable=False),
    Column("figure", Text, nullable=False),
    # 1 or 24 hours; 0: the first shots after a calibration, with which the others are compared.
    Column("hours", SmallInteger, nullable=False),
    # Whole hours since 1970 (UTC); of the first shots: when the calibration was made.
    Column("start", Integer, nullable=False),
    Column("n", Integer, nullable=False),
    Column("mean", Double, nullable=False),
    Column("minimum", Double, nullable=False),
    Column("maximum", Double, nullable=False),
    # Serves the rows of this hour and day, to which the next figures are added, and "what is older than".
    PrimaryKeyConstraint("station_id", "hours", "start", "camera", "figure"),
    check("camera_not_empty", "camera <> ''"),
    check("figure_not_empty", "figure <> ''"),
    check("possible_span", "hours IN (0, 1, 24)"),
    # A range also keeps out NaN and infinity.
    check(
        "possible_figures",
        "n > 0",
        "minimum >= -1e12",
        "minimum <= mean",
        "mean <= maximum",
        "maximum <= 1e12",
    ),
    sqlite_with_rowid=False,
)

# Which camera stood where when a calibration was used first: another one there was never calibrated.
camera_serials = Table(
    "camera_serials",
    metadata,
    Column("station_id", ForeignKey(stations.c.id), nullable=False),
    Column("camera", Text, nullable=False),
    Column("calibration_id", Text, nullable=False),
    Column("serial", Text, nullable=False),
    # Serves the comparison with the camera that answers.
    PrimaryKeyConstraint("station_id", "camera", "calibration_id"),
    check("camera_not_empty", "camera <> ''"),
    check("calibration_not_empty", "calibration_id <> ''"),
    check("serial_not_empty", "serial <> ''"),
    sqlite_with_rowid=False,
)
