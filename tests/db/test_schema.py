"""The database itself refuses rows that would lie, whoever writes them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any
from uuid import uuid4

import pytest
from sqlalchemy import Connection, Engine, Table, inspect, text
from sqlalchemy.exc import DBAPIError, IntegrityError

from db.connection import make_engine, parse_url
from db.records import (
    OF_GEOMETRY,
    ArchiveRemoval,
    CycleOutcome,
    EventRecord,
    Severity,
    Verdict,
    WheelOutcome,
)
from db.rows import flat_values
from db.schema import (
    CHANGING,
    adjusting_results,
    arrivals,
    axle_results,
    calibration_checks,
    calibrations,
    concession_withdrawals,
    concessions,
    cycles,
    doubt_closings,
    doubts,
    geometry_results,
    metadata,
    outbox,
    steering_axis_results,
    steering_results,
    vehicle_results,
    vehicles,
    wheel_results,
    zero_measurements,
    zero_revocations,
)
from db.store import ResultStore
from tests.db.example_records import (
    ANGLES,
    CALIBRATION,
    NOON,
    adjusting,
    axle,
    bad_vehicle,
    check,
    concession,
    corrected_wheel,
    cycle,
    doubt,
    doubt_closing,
    geometry,
    installation,
    limits,
    refused_wheel,
    revocation,
    shot,
    station,
    steering,
    steering_axis,
    study,
    study_value,
    wheel,
    withdrawal,
    zero,
)

TABLES = sorted(metadata.tables)
MEASURED_GEOMETRY = ("end_points", *(f"{name}{end}" for name in OF_GEOMETRY for end in ("", "_u")))
KEPT = sorted(set(TABLES) - {table.name for table in CHANGING})


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def engine(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Engine]:
    """A database with a row in every table; the tests leave it as they find it."""
    with ExitStack() as stack:
        if request.param == "sqlite":
            url = f"sqlite:///{tmp_path_factory.mktemp('schema') / 'results.db'}"
        else:
            url = stack.enter_context(request.getfixturevalue("postgres_server").database())
        with ResultStore(url, create=True) as store:
            store.record_calibration(CALIBRATION)
            checked = check()
            store.record_check(checked)
            store.record_zero(zero())
            store.revoke_zero(revocation())
            measured = cycle(
                geometry=geometry(),
                steering=steering(),
                steering_axes=(steering_axis(),),
                adjustings=(adjusting(),),
            )
            store.write_cycle(measured)
            released = bad_vehicle()
            store.write_cycle(released)
            granted = concession(released.uuid)
            store.grant_concession(granted)
            store.withdraw_concession(withdrawal(granted.uuid))
            store.describe_station(station(), (limits(),), (installation(),))
            planned, kept = study(), shot(measured.uuid)
            store.plan_study(planned)
            store.record_study_values([study_value(planned.uuid)])
            store.record_shot(kept)
            store.remove_shot(ArchiveRemoval(kept.uuid, NOON, "the ring is full"))
            spoken = doubt(measured.uuid, checked.uuid)
            store.record_found(lambda connection: [spoken])
            store.record_found(lambda connection: [doubt_closing(spoken.uuid)])
            store.record_event(EventRecord(NOON, "EOL-1", Severity.INFO, "station", "start", "started"))
        engine = make_engine(parse_url(url), timeout_s=5.0)
        with engine.begin() as connection:
            connection.execute(arrivals.insert().values(**ARRIVAL))
            if request.param == "postgresql":
                connection.execute(outbox.insert().values(kind="event", key="0"))
        yield engine
        engine.dispose()


@pytest.fixture
def connection(engine: Engine) -> Iterator[Connection]:
    """A transaction past the store's own checks, rolled back in the end."""
    with engine.connect() as connection:
        connection.execute(vehicles.insert().values(id=99, vin="TRUEWHEEL00000009", vehicle_type="compact"))
        yield connection


ARRIVAL = {
    "origin": uuid4(),
    "sequence": 1,
    "kind": "event",
    "key": "0",
    "station": "EOL-1",
    "arrived_utc": NOON,
}


def cycle_row(**changes: Any) -> dict[str, Any]:
    return flat_values(cycle()) | {"id": 99, "vehicle_id": 99, "stored_utc": NOON} | changes


def insert(connection: Connection, table: Table, values: dict[str, Any]) -> None:
    if "cycle_id" in table.c:
        connection.execute(cycles.insert().values(**cycle_row()))
        values = {"cycle_id": 99} | values
    if table is zero_revocations:
        connection.execute(zero_measurements.insert().values(**COMPLETE[zero_measurements]))
    if table is concession_withdrawals:
        insert(connection, concessions, COMPLETE[concessions] | {"id": 99})
    if table in (doubts, doubt_closings):
        connection.execute(cycles.insert().values(**cycle_row(uuid=DOUBTED.cycle)))
        checked = COMPLETE[calibration_checks] | {"uuid": DOUBTED.check_uuid}
        connection.execute(calibration_checks.insert().values(**checked))
    if table is doubt_closings:
        connection.execute(doubts.insert().values(**COMPLETE[doubts]))
        values = values | {"doubt": DOUBTED.uuid}
    connection.execute(table.insert().values(**values))


DOUBTED = doubt(uuid4(), uuid4())
CORRECTED = flat_values(corrected_wheel())
UNCHECKED: dict[str, Any] = {
    "straight_ahead": "not_checked", "reason_text": "no angle was told", "steer": None, "steer_u": None,
}  # fmt: skip
NO_AXIS: dict[str, Any] = {"caster": None, "caster_u": None, "verdict": Verdict.NONE}
REASON = {"reason_code": "sweep_too_small", "reason_text": "turn it farther"}
FAULT = {"outcome": CycleOutcome.FAULT, "reason_code": "camera", "reason_text": "no frame"}
IMPOSSIBLE: list[tuple[Table, str, dict[str, Any]]] = [
    (cycles, "verdict_has_vehicle_and_time", {"vehicle_id": None}),
    (cycles, "verdict_has_vehicle_and_time", {"measured_utc": None}),
    (cycles, "stop_has_reason", {"outcome": CycleOutcome.FAULT}),
    (cycles, "stop_has_reason", {"outcome": CycleOutcome.ABORTED}),
    (cycles, "stop_has_reason", FAULT | {"outcome": CycleOutcome.NOK}),
    (cycles, "reason_in_words", FAULT | {"reason_text": None}),
    (cycles, "monotonic_order", {"measured_monotonic_s": 99.0}),
    (cycles, "trigger_sequence_not_negative", {"trigger_sequence": -1}),
    (cycles, "station_not_empty", {"station": ""}),
    (cycles, "software_version_not_empty", {"software_version": ""}),
    (cycles, "config_hash_not_empty", {"config_hash": ""}),
    *[
        (wheel_results, "measured_is_complete", {name: None})
        for name in ("camber", "toe", "camber_u", "toe_u", "method", "calibration_id", "measured_utc")
    ],
    (wheel_results, "unmeasured_has_no_verdict", flat_values(refused_wheel(verdict=Verdict.NOK))),
    (
        wheel_results,
        "unmeasured_has_no_verdict",
        flat_values(refused_wheel(verdict=Verdict.NOK, outcome=WheelOutcome.FAULT)),
    ),
    (wheel_results, "unmeasured_has_no_angles", flat_values(refused_wheel(toe=0.0))),
    (
        wheel_results,
        "unmeasured_has_reason",
        flat_values(refused_wheel(reason_code=None, reason_text=None)),
    ),
    (wheel_results, "reason_in_words", flat_values(refused_wheel(reason_text=None))),
    (wheel_results, "ok_has_no_reason", {"reason_code": "toe_high", "reason_text": "toe too high"}),
    (wheel_results, "verdict_is_explained", {"guard_band": None}),
    (wheel_results, "verdict_is_explained", {"coverage_factor": None}),
    (
        wheel_results,
        "verdict_is_explained",
        dict.fromkeys(("camber_low", "camber_high", "toe_low", "toe_high")),
    ),
    (wheel_results, "ok_is_within_limits", {"toe": 0.1}),
    (wheel_results, "ok_is_within_limits", {"camber": -0.1}),
    (wheel_results, "limits_in_order", {"verdict": Verdict.NOK, "toe_low": 0.2, "toe_high": 0.1}),
    (wheel_results, "possible_angles", {"verdict": Verdict.NOK, "toe": 3.3}),
    (wheel_results, "possible_angles", {"verdict": Verdict.NOK, "toe": float("inf")}),
    (wheel_results, "possible_uncertainties", {"camber_u": 0.0}),
    (wheel_results, "possible_uncertainties", {"toe_u": -1e-5}),
    (wheel_results, "coverage_factor_positive", {"coverage_factor": 0.0}),
    (wheel_results, "possible_quality", {"points_used": -1}),
    (wheel_results, "wheel_not_empty", {"wheel": ""}),
    (axle_results, "verdict_is_explained", {"verdict": Verdict.OK}),
    (
        axle_results,
        "ok_is_within_limits",
        {"verdict": Verdict.OK, "guard_band": True, "coverage_factor": 2.0, "total_toe_high": 0.0},
    ),
    (axle_results, "possible_uncertainties", {"total_toe_u": 0.0}),
    (vehicle_results, "thrust_sign", {"thrust_sign": "up_positive"}),
    (
        vehicle_results,
        "ok_is_within_limits",
        {"verdict": Verdict.OK, "guard_band": False, "coverage_factor": 2.0, "thrust_angle_low": 0.1},
    ),
    (wheel_results, "possible_kind", {"kind": "tyre"}),
    (wheel_results, "possible_load", {"load_mm": -1.0}),
    (wheel_results, "possible_run_out", {"run_out": -0.1, "run_out_u": 0.01}),
    (wheel_results, "run_out_is_explained", {"run_out": 0.1}),
    (wheel_results, "possible_phase", {"run_out_phase": 4.0}),
    (wheel_results, "possible_tyre_share", {"toe_tyre_u": -1e-6}),
    (geometry_results, "reference", {"reference": "road"}),
    (geometry_results, "end_points", {"end_points": "rims"}),
    (geometry_results, "values_are_complete", {"track_rear": None}),
    (geometry_results, "values_are_complete", {"place_y_u": None}),
    (geometry_results, "unmeasured_has_no_verdict", dict.fromkeys(MEASURED_GEOMETRY)),
    (geometry_results, "verdict_is_explained", {"guard_band": None}),
    (geometry_results, "ok_is_within_limits", {"track_front": 1509.0}),
    (
        geometry_results,
        "limits_in_order",
        {"verdict": Verdict.NOK, "setback_rear_low": 2.0, "setback_rear_high": 1.0},
    ),
    (geometry_results, "possible_angles", {"verdict": Verdict.NOK, "yaw": 4.0}),
    (geometry_results, "possible_lengths", {"place_x": float("inf")}),
    (geometry_results, "possible_uncertainties", {"axle_offset_u": 0.0}),
    (geometry_results, "coverage_factor_positive", {"coverage_factor": 0.0}),
    (wheel_results, "raw_is_complete", {"toe_raw": 0.0}),
    (wheel_results, "raw_is_complete", CORRECTED | {"camber_raw_u": None}),
    (
        wheel_results,
        "raw_is_complete",
        flat_values(refused_wheel(camber_raw=0.0, toe_raw=0.0, camber_raw_u=1e-5, toe_raw_u=1e-5)),
    ),
    (wheel_results, "possible_raw_angles", CORRECTED | {"toe_raw": 4.0}),
    (wheel_results, "possible_raw_uncertainties", CORRECTED | {"toe_raw_u": 0.0}),
    (wheel_results, "possible_ride_height", {"ride_height": "high"}),
    (wheel_results, "possible_ride_height", {"ride_height_mm": -1.0}),
    (wheel_results, "refused_height_has_no_verdict", {"ride_height": "refused"}),
    (wheel_results, "refused_height_has_no_verdict", {"ride_height": "missing"}),
    (wheel_results, "corrected_height_is_explained", {"ride_height": "corrected"}),
    (steering_results, "straight_ahead", {"straight_ahead": "perhaps", "steer": None, "steer_u": None}),
    (steering_results, "reason_in_words", {"reason_text": "it was"}),
    (steering_results, "reason_in_words", UNCHECKED | {"reason_text": None}),
    (steering_results, "checked_has_angles", {"steer": None, "steer_u": None}),
    (steering_results, "checked_has_angles", UNCHECKED | {"steer": 0.0, "steer_u": 1e-4}),
    (steering_results, "checked_has_wheel", {"steering_wheel": None, "steering_wheel_u": None}),
    (steering_results, "values_have_uncertainties", {"steering_wheel_offset_u": None}),
    (steering_results, "refused_has_no_verdict", UNCHECKED | {"straight_ahead": "refused"}),
    (steering_results, "verdict_is_explained", {"guard_band": None}),
    (steering_results, "ok_is_within_limits", {"steering_wheel_offset": 0.05}),
    (steering_results, "ok_is_within_limits", {"caster_difference": 0.05}),
    (steering_results, "limits_in_order", {"verdict": Verdict.NOK, "caster_difference_low": 0.1}),
    (steering_results, "possible_wheel", {"steering_wheel": 20.1}),
    (steering_results, "possible_wheel", {"steering_wheel_age_s": -0.1}),
    (steering_results, "possible_angles", {"steer": 3.3}),
    (steering_results, "possible_uncertainties", {"kpi_difference_u": 0.0}),
    (steering_results, "coverage_factor_positive", {"coverage_factor": 0.0}),
    (steering_axis_results, "wheel_not_empty", {"wheel": ""}),
    (steering_axis_results, "reason_in_words", {"reason_code": "small"}),
    (steering_axis_results, "unmeasured_has_reason", NO_AXIS),
    (steering_axis_results, "unmeasured_has_no_verdict", NO_AXIS | REASON | {"verdict": Verdict.OK}),
    (steering_axis_results, "measured_is_explained", {"method": None}),
    (steering_axis_results, "values_have_uncertainties", {"lock_left_u": None}),
    (steering_axis_results, "verdict_is_explained", {"coverage_factor": None}),
    (steering_axis_results, "ok_is_within_limits", {"trail": 31.0}),
    (steering_axis_results, "limits_in_order", {"verdict": Verdict.NOK, "caster_low": 0.2}),
    (steering_axis_results, "possible_angles", {"kpi": 3.3}),
    (steering_axis_results, "possible_lengths", {"scrub": float("inf")}),
    (steering_axis_results, "possible_uncertainties", {"scrub_u": 0.0}),
    (steering_axis_results, "possible_quality", {"positions": -1}),
    (steering_axis_results, "coverage_factor_positive", {"coverage_factor": 0.0}),
    (adjusting_results, "wheel_not_empty", {"wheel": ""}),
    (adjusting_results, "adjuster", {"adjuster": "hammer"}),
    (adjusting_results, "outcome", {"outcome": "good"}),
    (adjusting_results, "reason", {"reason": "range"}),
    (adjusting_results, "reason", {"outcome": "unreachable"}),
    (adjusting_results, "reason", {"outcome": "unreachable", "reason": "tired"}),
    (adjusting_results, "was_turned", {"corrections": 0, "nuts_locked": 0, "drift": None}),
    (adjusting_results, "was_turned", {"nuts_locked": 3}),
    (adjusting_results, "drift_of_locked_nuts", {"drift": None}),
    (adjusting_results, "drift_of_locked_nuts", {"nuts_locked": 0}),
    (adjusting_results, "left_is_complete", {"left_toe": None}),
    (adjusting_results, "possible_angles", {"found_toe": 3.3}),
    (adjusting_results, "possible_angles", {"left_camber": -3.3}),
    (adjusting_results, "possible_angles", {"drift": float("inf")}),
    (adjusting_results, "possible_turns", {"turns": -2e6}),
    (adjusting_results, "possible_turns", {"turns_made": -0.5}),
    (adjusting_results, "possible_times", {"begun_s": -0.1}),
    (adjusting_results, "possible_times", {"ended_s": 2.0}),
    (adjusting_results, "operator_not_empty", {"operator": ""}),
    (doubts, "station_not_empty", {"station": ""}),
    (doubts, "wheel_not_empty", {"wheel": ""}),
    (doubts, "reason_not_empty", {"reason": ""}),
    (doubt_closings, "closed_by", {"closed_by": "nobody", "person": None}),
    (doubt_closings, "good_check_is_named", {"check_uuid": DOUBTED.check_uuid}),
    (doubt_closings, "good_check_is_named", {"closed_by": "good_check", "person": None}),
    (doubt_closings, "person_is_named", {"person": None}),
    (doubt_closings, "person_not_empty", {"person": ""}),
    (doubt_closings, "reason_not_empty", {"reason": ""}),
    (calibrations, "validity", {"valid_until_utc": NOON}),
    (calibration_checks, "has_figures", {"as_found": None}),
    (calibration_checks, "reason_not_empty", {"reason": ""}),
    (calibration_checks, "successor_has_both", {"predecessor_id": CALIBRATION.id, "as_left": {}}),
    (calibration_checks, "successor_has_both", {"predecessor_id": "cal-older"}),
    (zero_measurements, "id_not_empty", {"id": ""}),
    (zero_measurements, "rig_not_empty", {"rig": ""}),
    (zero_measurements, "shots_positive", {"shots": 0}),
    (zero_measurements, "possible_angles", {"certified_toe": 3.3}),
    (zero_measurements, "possible_uncertainties", {"camber_u": 0.0}),
    (zero_measurements, "possible_correlation", {"correlation": 1.1}),
    (zero_revocations, "reason_not_empty", {"reason": ""}),
    (concessions, "person_not_empty", {"person": ""}),
    (concessions, "reason_not_empty", {"reason": ""}),
    (concession_withdrawals, "person_not_empty", {"person": ""}),
    (concession_withdrawals, "reason_not_empty", {"reason": ""}),
    (vehicles, "vin_not_empty", {"vin": "", "vehicle_type": "compact"}),
]
COMPLETE: dict[Table, dict[str, Any]] = {
    cycles: cycle_row(),
    wheel_results: flat_values(wheel()),
    axle_results: flat_values(axle()),
    vehicle_results: flat_values(ANGLES),
    geometry_results: flat_values(geometry()),
    steering_results: flat_values(steering()),
    steering_axis_results: flat_values(steering_axis()),
    adjusting_results: flat_values(adjusting()),
    calibrations: flat_values(CALIBRATION) | {"id": "cal-3", "stored_utc": NOON},
    calibration_checks: flat_values(check()) | {"stored_utc": NOON, "uuid": uuid4()},
    zero_measurements: flat_values(zero("zero-2")) | {"stored_utc": NOON},
    zero_revocations: flat_values(revocation("zero-2")) | {"stored_utc": NOON},
    concessions: flat_values(concession(uuid4())) | {"stored_utc": NOON},
    concession_withdrawals: flat_values(withdrawal(uuid4())) | {"concession_id": 99, "stored_utc": NOON},
    doubts: flat_values(DOUBTED) | {"stored_utc": NOON},
    doubt_closings: flat_values(doubt_closing(DOUBTED.uuid)) | {"stored_utc": NOON},
    vehicles: {},
}


@pytest.mark.parametrize(
    ("table", "constraint", "changes"),
    IMPOSSIBLE,
    ids=[f"{table.name}-{name}-{number}" for number, (table, name, _) in enumerate(IMPOSSIBLE)],
)
def test_an_impossible_row_is_refused_by_name(
    connection: Connection, table: Table, constraint: str, changes: dict[str, Any]
) -> None:
    with pytest.raises(IntegrityError) as caught:
        insert(connection, table, COMPLETE[table] | changes)
    assert f"ck_{table.name}_{constraint}" in str(caught.value.orig)


@pytest.mark.parametrize(
    "table", [table for table in COMPLETE if COMPLETE[table]], ids=lambda table: table.name
)
def test_the_unchanged_rows_are_possible(connection: Connection, table: Table) -> None:
    insert(connection, table, COMPLETE[table] | ({"uuid": uuid4()} if "uuid" in table.c else {}))


def test_an_unknown_outcome_is_refused(connection: Connection) -> None:
    insert(connection, wheel_results, COMPLETE[wheel_results])
    with pytest.raises(IntegrityError) as caught:
        connection.execute(
            text(
                "INSERT INTO wheel_results (cycle_id, wheel, outcome, verdict, reason_code, reason_text)"
                " VALUES (99, 'rear_left', 'good', 'none', 'x', 'y')"
            )
        )
    assert "ck_wheel_results_outcome" in str(caught.value.orig)


@pytest.mark.parametrize("change", ["UPDATE {} SET {} = {}", "DELETE FROM {}"], ids=["update", "delete"])
@pytest.mark.parametrize("table", KEPT)
def test_what_is_stored_is_never_changed(engine: Engine, table: str, change: str) -> None:
    column = next(iter(metadata.tables[table].c)).name
    with pytest.raises(DBAPIError, match="never changed or deleted"), engine.begin() as connection:
        connection.exec_driver_sql(change.format(table, column, column))


def test_every_constraint_and_index_has_a_name(connection: Connection) -> None:
    inspector = inspect(connection)
    for table in TABLES:
        found = [
            inspector.get_pk_constraint(table),
            *inspector.get_foreign_keys(table),
            *inspector.get_unique_constraints(table),
            *inspector.get_check_constraints(table),
            *inspector.get_indexes(table),
        ]
        for item in found:
            assert item["name"], item
            assert item["name"][:3] in ("pk_", "fk_", "uq_", "ck_", "ix_"), item
