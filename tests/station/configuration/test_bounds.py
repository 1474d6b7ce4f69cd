"""Every number that a user may configure: accepted at its bound, refused beyond it, and its default.

The numbers here are promises to the user, written out and not read from the schema that they judge.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import pytest
from pydantic import BaseModel, ValidationError

from sensors.formats.truth import LoadOptions
from sensors.simulation.driver import RollerOptions, SimulatedOptions, VehicleOptions
from station.configuration.health import HealthOptions
from station.configuration.measure import MeasureOptions
from station.configuration.ride_heights import HeightCurve, HeightPoint, RideHeightOptions
from station.configuration.rigs import rig_model
from station.configuration.settings import (
    ArchiveSettings,
    CameraOptions,
    CycleSettings,
    DatabaseSettings,
    LineSettings,
    StandOptions,
    StationSettings,
    station_model,
)
from station.configuration.steering import SteeringOptions
from station.configuration.tolerances import Tolerance
from station.configuration.vehicle_types import VehicleType
from station.rehearsal.simulation import OpticsOptions, PatternOptions, SimulationConfig

HEIGHT_CURVE: dict[str, Any] = {
    "design_mm": 380.0,
    "points": [
        {"height_mm": 50.0, "camber_deg": 0.0, "toe_deg": 0.0},
        {"height_mm": 1500.0, "camber_deg": 0.0, "toe_deg": 0.0},
    ],
}
NEEDED: dict[type[BaseModel], dict[str, Any]] = {
    StationSettings: {"id": "station_1", "name": "One", "plant": "Plant"},
    DatabaseSettings: {"url": "sqlite:///x.db"},
    ArchiveSettings: {"folder": "images"},
    LineSettings: {"channel": "can0", "dbc": "line.dbc"},
    CycleSettings: {},
    CameraOptions: {},
    HealthOptions: {},
    MeasureOptions: {},
    StandOptions: {},
    SimulatedOptions: {"seed": 1},
    RollerOptions: {},
    VehicleOptions: {},
    LoadOptions: {},
    OpticsOptions: {},
    PatternOptions: {"column_pitch_mm": 200.0, "row_pitch_mm": 200.0, "width_mm": 0.001, "edge_mm": 0.001},
    SimulationConfig: {},
    Tolerance: {},
    SteeringOptions: {"ratio": 15.0},
    HeightPoint: {"height_mm": 380.0, "camber_deg": 0.0, "toe_deg": 0.0},
    HeightCurve: HEIGHT_CURVE,
    RideHeightOptions: {"at": {"front": HEIGHT_CURVE}},
    VehicleType: {
        "number": 1,
        "name": "Car",
        "axles": {
            "front": {
                "camber": {"lower_deg": -1.0, "upper_deg": 1.0},
                "toe": {"lower_deg": -1.0, "upper_deg": 1.0},
            }
        },
    },
}
RIG, STATION = rig_model({"simulated"}), station_model({"simulated", "recorded"})
NOUGHT, JUST = math.ulp(0.0), 1e-9


class Bounds(NamedTuple):
    """Default of a field, the outermost values accepted, and the next ones refused."""

    model: type[BaseModel]
    field: str
    default: Any
    low: Any
    below: Any
    high: Any
    above: Any


def days(model: type[BaseModel], field: str, default: float) -> Bounds:
    return Bounds(model, field, default, NOUGHT, 0.0, 36_500.0, 36_500.001)


def seconds(model: type[BaseModel], field: str, default: float | None, most: float = 600.0) -> Bounds:
    return Bounds(model, field, default, NOUGHT, 0.0, most, most + 0.001)


def sizes(field: str, default: float, most: float) -> Bounds:
    return Bounds(PatternOptions, field, default, NOUGHT, 0.0, most, most + 0.001)


BOUNDS = (
    seconds(DatabaseSettings, "timeout_s", 5.0),
    Bounds(DatabaseSettings, "minimum_free_mb", 500.0, 0.0, -JUST, 1e7, 1e7 + 0.01),
    Bounds(ArchiveSettings, "most_gb", 100.0, NOUGHT, 0.0, 1e6, 1e6 + 0.001),
    days(ArchiveSettings, "ordinary_days", 14.0),
    days(ArchiveSettings, "evidence_days", 365.0),
    Bounds(LineSettings, "bitrate", 500_000, 10_000, 9_999, 1_000_000, 1_000_001),
    seconds(LineSettings, "acknowledge_timeout_s", 2.0),
    seconds(LineSettings, "communication_timeout_s", None),
    seconds(CycleSettings, "shoot_timeout_s", 2.0),
    seconds(CycleSettings, "measure_timeout_s", 30.0),
    seconds(CycleSettings, "adjust_timeout_s", 600.0, 7200.0),
    seconds(CycleSettings, "live_max_age_s", 1.0),
    days(CycleSettings, "calibration_max_age_days", 365.0),
    Bounds(CameraOptions, "exposure_ms", 5.0, NOUGHT, 0.0, 1000.0, 1000.001),
    seconds(CameraOptions, "call_timeout_s", 10.0),
    Bounds(CameraOptions, "gain_db", 0.0, 0.0, -JUST, 60.0, 60.001),
    Bounds(HealthOptions, "temperature_warn_c", 65.0, -40.0, -40.1, 150.0, 150.1),
    Bounds(HealthOptions, "temperature_stop_c", None, 65.1, -40.1, 150.0, 150.1),
    Bounds(HealthOptions, "failures_warn", 2, 1, 0, 100, 101),
    Bounds(HealthOptions, "link_warn_share", 0.9, NOUGHT, 0.0, 1.0, 1.001),
    Bounds(HealthOptions, "width_warn_ratio", 1.25, 1.0 + JUST, 1.0, 100.0, 100.1),
    Bounds(HealthOptions, "width_stop_ratio", None, 1.26, 1.0, 100.0, 100.1),
    Bounds(HealthOptions, "light_warn_ratio", 1.5, 1.0 + JUST, 1.0, 100.0, 100.1),
    Bounds(HealthOptions, "light_stop_ratio", None, 1.51, 1.0, 100.0, 100.1),
    Bounds(HealthOptions, "row_warn_px", 0.1, NOUGHT, 0.0, 100.0, 100.1),
    Bounds(HealthOptions, "row_stop_px", None, 0.11, 0.0, 100.0, 100.1),
    Bounds(MeasureOptions, "minimum_points", 300, 10, 9, 1_000_000, 1_000_001),
    Bounds(MeasureOptions, "maximum_angle_deg", 10.0, NOUGHT, 0.0, 15.0, 15.001),
    Bounds(MeasureOptions, "coverage_factor", 2.0, 1.6, 1.599, 5.0, 5.001),
    Bounds(StandOptions, "road_z_mm", None, -2000.0, -2000.1, 2000.0, 2000.1),
    Bounds(StandOptions, "temperature_sigma_k", 2.0, 0.0, -JUST, 30.0, 30.001),
    Bounds(StandOptions, "gradient_sigma_k_per_m", 0.2, 0.0, -JUST, 10.0, 10.001),
    Bounds(StandOptions, "expansion_ppm_per_k", 12.0, 0.0, -JUST, 40.0, 40.001),
    Bounds(SimulatedOptions, "seed", 1, 0, -1, 4_294_967_295, 4_294_967_296),
    Bounds(SimulatedOptions, "camber_deg", 0.0, -5.0, -5.001, 5.0, 5.001),
    Bounds(SimulatedOptions, "toe_deg", 0.0, -5.0, -5.001, 5.0, 5.001),
    Bounds(SimulatedOptions, "spread_deg", 0.1, 0.0, -JUST, 3.0, 3.001),
    Bounds(SimulatedOptions, "run_out_deg", 0.0, 0.0, -JUST, 2.0, 2.001),
    Bounds(SimulatedOptions, "second_harmonic_mm", 0.0, 0.0, -JUST, 5.0, 5.001),
    Bounds(SimulatedOptions, "rim_runout_mm", 0.0, 0.0, -JUST, 5.0, 5.001),
    Bounds(VehicleOptions, "yaw_deg", 0.0, 0.0, -JUST, 2.0, 2.001),
    Bounds(VehicleOptions, "offset_mm", 0.0, 0.0, -JUST, 25.0, 25.001),
    Bounds(VehicleOptions, "load_mm", 0.0, 0.0, -JUST, 15.0, 15.001),
    Bounds(VehicleOptions, "runout_mm", 0.0, 0.0, -JUST, 5.0, 5.001),
    Bounds(VehicleOptions, "tyre_width_sigma_mm", 0.0, 0.0, -JUST, 5.0, 5.001),
    Bounds(RollerOptions, "speed_deg_s", 170.0, -720.0, -720.01, 720.0, 720.01),
    Bounds(RollerOptions, "interval_s", 0.28, NOUGHT, 0.0, 10.0, 10.001),
    Bounds(RollerOptions, "wander_mm", 1.0, 0.0, -JUST, 20.0, 20.001),
    Bounds(RollerOptions, "wander_deg", 0.05, 0.0, -JUST, 2.0, 2.001),
    Bounds(LoadOptions, "bulge_mm", 0.0, 0.0, -JUST, 30.0, 30.001),
    Bounds(LoadOptions, "width_deg", 24.0, 5.0, 4.999, 60.0, 60.001),
    Bounds(LoadOptions, "side_mm", 0.0, -30.0, -30.001, 30.0, 30.001),
    Bounds(LoadOptions, "side_width_deg", 48.0, 5.0, 4.999, 120.0, 120.001),
    Bounds(LoadOptions, "longitudinal_mm", 0.0, -10.0, -10.001, 10.0, 10.001),
    Bounds(LoadOptions, "crest", 0.55, 0.2, 0.199, 0.8, 0.801),
    Bounds(LoadOptions, "tread", 0.2, 0.0, -JUST, 0.9, 0.901),
    Bounds(OpticsOptions, "blur_px", 0.7, 0.0, -JUST, 5.0, 5.001),
    Bounds(OpticsOptions, "full_well_e", 10_000.0, 100.0, 99.999, 1e6, 1e6 + 0.001),
    Bounds(OpticsOptions, "read_noise_e", 12.0, 0.0, -JUST, 1000.0, 1000.001),
    Bounds(PatternOptions, "columns", 13, 1, 0, 200, 201),
    Bounds(PatternOptions, "rows", 9, 1, 0, 200, 201),
    sizes("column_pitch_mm", 15.0, 200.0),
    sizes("row_pitch_mm", 17.0, 200.0),
    sizes("width_mm", 0.7, 20.0),
    sizes("edge_mm", 0.3, 20.0),
    Bounds(SimulationConfig, "ambient", 0.15, 0.0, -JUST, 10.0, 10.001),
    Bounds(VehicleType, "number", 1, 0, -1, 65_535, 65_536),
    Bounds(VehicleType, "tyre_width_mm", None, 80.0, 79.9, 500.0, 500.1),
    Bounds(VehicleType, "tyre_width_sigma_mm", 0.5, 0.0, -JUST, 5.0, 5.001),
    Bounds(SteeringOptions, "ratio", 15.0, 5.0, 4.999, 40.0, 40.001),
    Bounds(SteeringOptions, "ratio_sigma", 0.3, 0.0, -JUST, 5.0, 5.001),
    Bounds(SteeringOptions, "offset_deg", 0.0, -45.0, -45.001, 45.0, 45.001),
    Bounds(SteeringOptions, "angle_sigma_deg", 0.2, 0.001, 0.0009, 5.0, 5.001),
    seconds(SteeringOptions, "oldest_s", 0.5, 60.0),
    Bounds(SteeringOptions, "largest_deg", 5.0, NOUGHT, 0.0, 90.0, 90.001),
    Bounds(HeightPoint, "height_mm", 380.0, 50.0, 49.999, 1500.0, 1500.001),
    Bounds(HeightPoint, "camber_deg", 0.0, -15.0, -15.001, 15.0, 15.001),
    Bounds(HeightPoint, "toe_deg", 0.0, -5.0, -5.001, 5.0, 5.001),
    Bounds(HeightCurve, "design_mm", 380.0, 50.0, 49.999, 1500.0, 1500.001),
    Bounds(RideHeightOptions, "sigma_mm", 1.0, 0.01, 0.009, 20.0, 20.001),
    seconds(RideHeightOptions, "oldest_s", 60.0, 3600.0),
    Bounds(RideHeightOptions, "largest_mm", 30.0, NOUGHT, 0.0, 300.0, 300.001),
)


def complaints(model: type[BaseModel], **values: Any) -> str:
    """Names of the fields that are refused, `model` for all of it together; empty where all is accepted."""
    try:
        model.model_validate(NEEDED.get(model, {}) | values)
    except ValidationError as caught:
        return ", ".join(".".join(map(str, error["loc"])) or "model" for error in caught.errors())
    return ""


def refused(model: type[BaseModel], **values: Any) -> str:
    found = complaints(model, **values)
    assert found, f"{model.__name__} accepts {values}"
    return found


@pytest.mark.parametrize("bounds", BOUNDS, ids=lambda b: f"{b.model.__name__}.{b.field}")
def test_a_number_is_accepted_at_its_bounds_and_refused_beyond(bounds: Bounds) -> None:
    whole = isinstance(bounds.low, int)
    for accepted in (bounds.low, bounds.high):
        # Bounds of a field by itself; what two fields must be together has tests of its own.
        assert bounds.field not in complaints(bounds.model, **{bounds.field: accepted})
    for beyond in (bounds.below, bounds.above, *(() if whole else (math.nan, math.inf, -math.inf))):
        assert bounds.field in refused(bounds.model, **{bounds.field: beyond})
    for nonsense in ("5", None if bounds.default is not None else "none", True, [5]):
        assert bounds.field in refused(bounds.model, **{bounds.field: nonsense})
    if whole:
        assert bounds.field in refused(bounds.model, **{bounds.field: bounds.low + 0.5})


@pytest.mark.parametrize("bounds", BOUNDS, ids=lambda b: f"{b.model.__name__}.{b.field}")
def test_a_number_that_is_left_out_has_its_published_default(bounds: Bounds) -> None:
    needed = NEEDED[bounds.model]
    if bounds.field not in needed:
        assert getattr(bounds.model.model_validate(needed), bounds.field) == bounds.default
    elif bounds.model is PatternOptions:
        assert getattr(PatternOptions(), bounds.field) == bounds.default


@pytest.mark.parametrize("field", ["nominal_deg", "lower_deg", "upper_deg", "tolerance_deg"])
def test_limits_of_angles_end_at_ten_degrees(field: str) -> None:
    others: dict[str, dict[str, float]] = {
        "nominal_deg": {"tolerance_deg": 0.1},
        "lower_deg": {"upper_deg": 10.0},
        "upper_deg": {"lower_deg": -10.0},
        "tolerance_deg": {"nominal_deg": 0.0},
    }
    lowest = {"upper_deg": -9.999, "tolerance_deg": NOUGHT}.get(field, -10.0)
    highest = {"lower_deg": 9.999}.get(field, 10.0)
    for value in (lowest, highest):
        assert getattr(Tolerance.model_validate(others[field] | {field: value}), field) == value
    beyond = (0.0, 10.001) if field == "tolerance_deg" else (-10.001, 10.001)
    for value in (*beyond, math.nan, math.inf):
        assert field in refused(Tolerance, **(others[field] | {field: value}))


def test_the_depth_range_ends_at_half_a_metre_and_is_in_order() -> None:
    for accepted in ((-500.0, 500.0), (-500.0, -499.9), (0.0, 0.001)):
        assert MeasureOptions(depth_range_mm=accepted).depth_range_mm == accepted
    for beyond in ((-500.1, 0.0), (0.0, 500.1), (math.nan, 0.0), (0.0,), (0.0, 1.0, 2.0)):
        assert "depth_range_mm" in refused(MeasureOptions, depth_range_mm=beyond)
    for order in ((0.0, 0.0), (1.0, -1.0)):
        with pytest.raises(ValueError, match="the lower value first"):
            MeasureOptions(depth_range_mm=order)
    defaults = MeasureOptions().settings()
    assert defaults.depth_range_mm == (-60.0, 60.0)
    assert (defaults.method, defaults.allow_lost_head) == ("revolution", False)
    chosen = MeasureOptions(
        depth_range_mm=(-5.0, 7.0),
        method="plane",
        minimum_points=11,
        maximum_angle_deg=3.0,
        coverage_factor=2.5,
        allow_lost_head=True,
    ).settings()
    assert (chosen.depth_range_mm, chosen.method, chosen.minimum_points) == ((-5.0, 7.0), "plane", 11)
    assert (chosen.maximum_angle, chosen.coverage_factor) == (pytest.approx(math.radians(3.0)), 2.5)
    assert chosen.allow_lost_head


@pytest.mark.parametrize(
    ("model", "field", "accepted", "refusals"),
    [
        (StationSettings, "id", ("a", "9", "A" + 63 * "_"), ("", "_a", 65 * "a", "a b", "ä")),
        (StationSettings, "name", ("x", 80 * "x"), ("", 81 * "x", "a\nb", "a\x7fb")),
        (StationSettings, "plant", ("x", 80 * "x"), ("", 81 * "x", "a\tb")),
        (DatabaseSettings, "url", ("x", 1000 * "x"), ("", 1001 * "x")),
        (DatabaseSettings, "central_url", ("x", 1000 * "x"), ("", 1001 * "x")),
        (ArchiveSettings, "folder", ("x", 1000 * "x"), ("", 1001 * "x")),
        (LineSettings, "interface", ("a", 40 * "a"), ("", 41 * "a", "A", "a-b")),
        (LineSettings, "channel", ("x", 200 * "x"), ("", 201 * "x")),
        (LineSettings, "dbc", ("x", 1000 * "x"), ("", 1001 * "x")),
        (LineSettings, "log", ("x", 1000 * "x"), ("", 1001 * "x")),
        (CycleSettings, "image_folder", ("x", 1000 * "x"), ("", 1001 * "x")),
        (VehicleType, "name", ("x", 80 * "x"), ("", 81 * "x", "a\nb")),
    ],
)
def test_a_text_is_accepted_at_its_length_and_refused_beyond(
    model: type[BaseModel], field: str, accepted: tuple[str, ...], refusals: tuple[str, ...]
) -> None:
    for text in accepted:
        assert getattr(model.model_validate(NEEDED[model] | {field: text}), field) == text
    for text in refusals:
        assert field in refused(model, **{field: text})


@pytest.mark.parametrize("name", ["front_left", "a_right", "a" + 30 * "b" + "_left"])
def test_names_of_wheels_are_an_axle_and_a_side(name: str) -> None:
    rig = RIG.model_validate({"name": name, "simulated": {"seed": 1}})
    assert rig.axle == name.rpartition("_")[0]
    assert rig.side == name.rpartition("_")[2]
    for wrong in (name.upper(), name + "s", "_" + name, name.replace("_", " "), "a" + 31 * "b" + "_left"):
        assert "name" in refused(RIG, name=wrong, simulated={"seed": 1})


def test_a_station_has_one_to_sixteen_rigs_and_a_vehicle_one_to_eight_axles() -> None:
    def station(rigs: int) -> dict[str, Any]:
        return {
            "station": NEEDED[StationSettings],
            "database": NEEDED[DatabaseSettings],
            "line": NEEDED[LineSettings],
            "vehicle_types": "vehicles",
            "rigs": tuple({"name": f"axle{k}_left", "simulated": {"seed": k}} for k in range(rigs)),
        }

    for count in (1, 16):
        assert len(STATION.model_validate(station(count)).rigs) == count
    for count in (0, 17):
        assert "rigs" in refused(STATION, **station(count))
    (axle,) = NEEDED[VehicleType]["axles"].values()
    for count in (1, 8):
        axles = {f"axle{k}": axle for k in range(count)}
        assert len(VehicleType.model_validate(NEEDED[VehicleType] | {"axles": axles}).axles) == count
    for count in (0, 9):
        assert "axles" in refused(VehicleType, axles={f"axle{k}": axle for k in range(count)})
    assert VehicleType.model_validate(NEEDED[VehicleType]).guard_band is True
    assert VehicleType.model_validate(NEEDED[VehicleType]).thrust_sign == "left_positive"


def numbers_without_bounds(schema: dict[str, Any]) -> list[str]:
    """Fields of all tables of a schema that are numbers open to one side."""

    def is_open(field: dict[str, Any]) -> bool:
        kinds = [field, *field.get("anyOf", []), *field.get("prefixItems", [])]
        return any(
            kind.get("type") in ("number", "integer")
            and "enum" not in kind
            and "const" not in kind
            and not (
                {"minimum", "exclusiveMinimum"} & set(kind) and {"maximum", "exclusiveMaximum"} & set(kind)
            )
            for kind in kinds
        )

    return [
        f"{table.get('title')}.{name}"
        for table in (schema, *schema.get("$defs", {}).values())
        for name, field in table.get("properties", {}).items()
        if is_open(field)
    ]


@pytest.mark.parametrize("model", [STATION, VehicleType, SimulationConfig])
def test_no_number_is_open_to_one_side(model: type[BaseModel]) -> None:
    assert numbers_without_bounds(model.model_json_schema()) == []
    assert numbers_without_bounds({"title": "T", "properties": {"x": {"type": "number", "minimum": 0}}})


WIDEST = {
    "camber": 3.0,
    "toe": 1.0,
    "total_toe": 2.0,
    "camber_difference": 3.0,
    "thrust_angle": 1.0,
    "yaw": 3.0,
}


@pytest.mark.parametrize("name", WIDEST)
@pytest.mark.parametrize("centre", [0.0, -0.7])
def test_limits_that_are_arcminutes_are_refused_with_what_they_are_in_degrees(
    name: str, centre: float
) -> None:
    """A tolerance of 5′ written as 5 was taken as 5°: every wheel was accepted."""

    def vehicle(**tolerance: float) -> VehicleType:
        good = {"lower_deg": -0.5, "upper_deg": 0.5}
        axle = {"camber": good, "toe": good}
        whole = {"number": 1, "name": "Car", "axles": {"front": axle}}
        if name in ("thrust_angle", "yaw"):
            return VehicleType.model_validate(whole | {"thrust_angle": good} | {name: tolerance})
        return VehicleType.model_validate(whole | {"axles": {"front": axle | {name: tolerance}}})

    widest = WIDEST[name]
    vehicle(nominal_deg=centre, tolerance_deg=widest)
    vehicle(lower_deg=centre - widest, upper_deg=centre + widest)
    for far in (
        {"nominal_deg": centre, "tolerance_deg": 1.01 * widest},
        {"lower_deg": centre - 1.02 * widest, "upper_deg": centre + widest},
        {"nominal_deg": centre, "tolerance_deg": 5.0},
    ):
        with pytest.raises(ValidationError) as caught:
            vehicle(**far)
        (details,) = caught.value.errors()
        inner = details["ctx"]["error"]
        assert inner.field == name
        assert inner.expected == f"limits at most ±{widest:g}° wide"
        assert "arcminutes taken for degrees" in inner.cure


def test_limits_in_the_wrong_order_are_said_to_be_exchanged() -> None:
    with pytest.raises(ValidationError) as caught:
        Tolerance.model_validate({"lower_deg": 0.5, "upper_deg": -0.5})
    (details,) = caught.value.errors()
    assert details["ctx"]["error"].cure == "It would fit with the two exchanged"


@pytest.mark.parametrize(
    ("k", "words"),
    [
        (0.95, "0.95 would be a level of confidence"),
        (95.0, "95 would be a level of confidence"),
        (1.0, "1 would make every u95 a standard uncertainty"),
        (20.0, "2 stands for about 95 %"),
    ],
)
def test_a_coverage_factor_that_is_none_is_told_as_what_it_is(k: float, words: str) -> None:
    """With 1 every value called u95 was a standard uncertainty, and guard bands were half as wide."""
    with pytest.raises(ValidationError) as caught:
        MeasureOptions.model_validate({"coverage_factor": k})
    (details,) = caught.value.errors()
    assert details["loc"] == ("coverage_factor",)
    assert words in details["ctx"]["error"].cure
