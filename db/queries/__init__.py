"""The read side of the result database: who may only read asks here; see `docs/database.md`."""

from db.queries.adjustings import Adjusted, adjusted
from db.queries.archived import (
    ArchivedCycle,
    archived_cycles,
    calibrations_by_id,
    configuration_in_force,
    cycles_of_vin,
    kept_images,
)
from db.queries.cameras import camera_trends
from db.queries.filters import EVERYTHING, Characteristic, Filter, Shift
from db.queries.masters import (
    DoubtedVehicle,
    RigSince,
    StoredCheck,
    doubted_vehicles,
    doubts_about,
    newest_checks,
    newest_news,
    open_doubts_before,
    rigs_since,
    vehicles_in_doubt,
)
from db.queries.names import KnownNames, known_names, require_known
from db.queries.reader import ResultReader
from db.queries.repairs import FirstPass, Repaired, RepairLoop, repair_loop
from db.queries.series import ValueSeries, cycle_records, value_series
from db.queries.since_check import (
    SinceCheck,
    VehicleSince,
    VehiclesSince,
    checks_and_since,
    since_last_good_check,
)
from db.queries.studies import gauge_studies, gauge_study, gauge_value_counts
from db.queries.summed import (
    CharacteristicMoments,
    GroupBy,
    ReasonCount,
    WheelCounts,
    YieldCounts,
    characteristic_moments,
    reasons,
    wheel_counts,
    yield_counts,
)
from db.queries.traces import (
    CheckOfStation,
    VinHistory,
    checks,
    events,
    station_names,
    vin_history,
)
from db.records import Quantity

__all__ = [
    "EVERYTHING",
    "Adjusted",
    "ArchivedCycle",
    "Characteristic",
    "CharacteristicMoments",
    "CheckOfStation",
    "DoubtedVehicle",
    "Filter",
    "FirstPass",
    "GroupBy",
    "KnownNames",
    "Quantity",
    "ReasonCount",
    "RepairLoop",
    "Repaired",
    "ResultReader",
    "RigSince",
    "Shift",
    "SinceCheck",
    "StoredCheck",
    "ValueSeries",
    "VehicleSince",
    "VehiclesSince",
    "VinHistory",
    "WheelCounts",
    "YieldCounts",
    "adjusted",
    "archived_cycles",
    "calibrations_by_id",
    "camera_trends",
    "characteristic_moments",
    "checks",
    "checks_and_since",
    "configuration_in_force",
    "cycle_records",
    "cycles_of_vin",
    "doubted_vehicles",
    "doubts_about",
    "events",
    "gauge_studies",
    "gauge_study",
    "gauge_value_counts",
    "kept_images",
    "known_names",
    "moments",
    "newest_checks",
    "newest_news",
    "open_doubts_before",
    "reasons",
    "repair_loop",
    "require_known",
    "rigs_since",
    "since_last_good_check",
    "station_names",
    "value_series",
    "vehicles_in_doubt",
    "vin_history",
    "wheel_counts",
    "yield_counts",
]
