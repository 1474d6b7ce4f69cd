"""The tables, as this program expects them; `db/migrations` builds them.

Only migrations create tables, so that a database and its revision never disagree; a test holds this package
and the migrations equal. Every CHECK makes rows impossible that would lie: an OK without a value, a fault
with a verdict. Angles are radians, times UTC. Triggers refuse every UPDATE and DELETE of what is stored; only
the tables of `CHANGING` are kept up to date instead.
"""

from db.schema.adjusting import adjusting_results
from db.schema.base import NAMING_CONVENTION, UtcDateTime, metadata
from db.schema.cameras import camera_history, camera_serials
from db.schema.chain import chain_links
from db.schema.concessions import concession_withdrawals, concessions
from db.schema.doubts import doubt_closings, doubts
from db.schema.geometry import geometry_results
from db.schema.levels import part_column, results_of
from db.schema.plant import installations, plants, rigs, station_versions, stations, vehicle_type_limits
from db.schema.quality import archive_removals, archived_shots, gauge_studies, gauge_values
from db.schema.results import (
    axle_results,
    calibration_checks,
    calibrations,
    cycles,
    events,
    vehicle_results,
    vehicles,
    wheel_results,
    zero_measurements,
    zero_revocations,
)
from db.schema.shipping import arrivals, outbox, shipments, station_leases
from db.schema.steering import steering_axis_results, steering_results
from db.schema.sums import (
    counted_categories,
    result_counts,
    summed_characteristics,
    sums_state,
    value_sums,
)

# Sums that can be built again, how far the outbox is shipped, who ships, how cameras were.
CHANGING = (
    summed_characteristics,
    counted_categories,
    value_sums,
    result_counts,
    sums_state,
    shipments,
    station_leases,
    camera_history,
    camera_serials,
)

# Holds nothing that is not in a table of records.
BOOKKEEPING = (*CHANGING, outbox, arrivals, chain_links)

__all__ = [
    "BOOKKEEPING",
    "CHANGING",
    "NAMING_CONVENTION",
    "UtcDateTime",
    "adjusting_results",
    "archive_removals",
    "archived_shots",
    "arrivals",
    "axle_results",
    "calibration_checks",
    "calibrations",
    "camera_history",
    "camera_serials",
    "chain_links",
    "concession_withdrawals",
    "concessions",
    "counted_categories",
    "cycles",
    "doubt_closings",
    "doubts",
    "events",
    "gauge_studies",
    "gauge_values",
    "geometry_results",
    "installations",
    "metadata",
    "outbox",
    "part_column",
    "plants",
    "result_counts",
    "results_of",
    "rigs",
    "shipments",
    "station_leases",
    "station_versions",
    "stations",
    "steering_axis_results",
    "steering_results",
    "summed_characteristics",
    "sums_state",
    "value_sums",
    "vehicle_results",
    "vehicle_type_limits",
    "vehicles",
    "wheel_results",
    "zero_measurements",
    "zero_revocations",
]
