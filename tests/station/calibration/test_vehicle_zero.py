"""A master vehicle that stands askew corrects every rig by its certificate, and not by its yaw."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from alignment.errors import ConfigurationError
from alignment.units import ARCMIN
from alignment.vehicle.geometry import VehicleGeometry, vehicle_geometry
from alignment.vehicle.wheel_axes import FOUR_WHEELS, WheelAxis
from station.calibration.vehicle_zero import MasterVehicle, lengths_found, read_master_vehicle, vehicle_zeros
from station.calibration.zero import SeenMaster
from tests import rendered
from tests.station.cycle.test_vehicle_frame import PLACES, seen, side_of

NOW = datetime(2026, 11, 30, tzinfo=UTC)
YAW_DEG = 0.1
TEXT = """
name = "MV-3"
u95_deg = 0.001
u95_mm = 0.02
[wheels]
front_left = { camber_deg = 0.0, toe_deg = 0.02 }
front_right = { camber_deg = 0.0, toe_deg = 0.0 }
rear_left = { camber_deg = 0.0, toe_deg = 0.0 }
rear_right = { camber_deg = -0.01, toe_deg = 0.0 }
[lengths_mm]
sidewall_track_front = 1700.4
wheelbase_left = 2700.0
"""


def certificate(folder: Path, text: str = TEXT) -> MasterVehicle:
    path = folder / "master.toml"
    path.write_text(text, encoding="utf-8")
    return read_master_vehicle(path)


def geometry() -> VehicleGeometry:
    """Of a vehicle of zero angles that is turned by `YAW_DEG`, as its rigs see it."""
    turn = math.radians(YAW_DEG)
    axes = {}
    for name, found in seen(YAW_DEG).items():
        x, y, z = PLACES[name]
        point = np.array(
            [x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn), z]
        )
        assert found.reference is not None
        axes[name] = WheelAxis(side_of(name), found.camber, found.toe, point, found.reference.covariance)
    return vehicle_geometry(axes)


def masters() -> dict[str, tuple[SeenMaster, object]]:
    return {name: (SeenMaster(found, 1, NOW, None), rendered.rig()) for name, found in seen(YAW_DEG).items()}


def test_the_yaw_of_a_master_vehicle_is_no_zero_of_its_rigs(tmp_path: Path) -> None:
    """Against the stand each toe was off by 6′, and every later wheel would have been turned by it."""
    found = vehicle_zeros(masters(), geometry(), certificate(tmp_path), 0.17)  # type: ignore[arg-type]
    off = [(zero.camber - zero.certified_camber, zero.toe - zero.certified_toe) for zero in found]
    expected = [(0.0, -0.02), (0.0, 0.0), (0.0, 0.0), (0.01, 0.0)]
    assert np.degrees(off) == pytest.approx(np.array(expected), abs=1e-6)
    assert [zero.master for zero in found] == [f"MV-3, {name.replace('_', ' ')}" for name in FOUR_WHEELS]
    # What the yaw and the certificate are not known by is in each.
    assert all(zero.toe_u > math.radians(0.0005) for zero in found)
    assert all(zero.forced_reason is None for zero in found)


def test_lengths_are_compared_with_the_certificate(tmp_path: Path) -> None:
    lengths = {each.name: each for each in lengths_found(certificate(tmp_path), geometry())}
    assert set(lengths) == {"sidewall_track_front", "wheelbase_left"}
    assert lengths["sidewall_track_front"].value == pytest.approx(1700.0)
    assert lengths["wheelbase_left"].u95 > 0.02


def test_a_length_that_no_frame_is_off_by_is_refused_unless_forced(tmp_path: Path) -> None:
    wrong = certificate(tmp_path, TEXT.replace("1700.4", "1706.0"))
    with pytest.raises(ConfigurationError, match=r"sidewall_track_front 1706, measured 1700\.000"):
        vehicle_zeros(masters(), geometry(), wrong, 0.17)  # type: ignore[arg-type]
    forced = vehicle_zeros(masters(), geometry(), wrong, 0.17, forced_reason="other tyres")  # type: ignore[arg-type]
    assert {zero.forced_reason for zero in forced} == {"other tyres"}


def test_one_angle_that_is_not_believed_stores_no_zero_of_any_rig(tmp_path: Path) -> None:
    wrong = certificate(tmp_path, TEXT.replace("camber_deg = -0.01", "camber_deg = -0.3"))
    with pytest.raises(ConfigurationError, match="certified angles within"):
        vehicle_zeros(masters(), geometry(), wrong, 0.17, 10.0 * ARCMIN)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("rear_right = {", "rear_rihgt = {", "wheels"),
        ("toe_deg = 0.02", "toe_deg = 12", "toe_deg"),
        ("1700.4", "1.7", "sidewall_track_front"),
        ("u95_mm", "u95_um", "u95_um"),
        ("[wheels]", "[wheels", "TOML"),
    ],
)
def test_a_certificate_that_is_none_is_one_clear_error(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said) as caught:
        certificate(tmp_path, TEXT.replace(old, new))
    assert "master.toml" in str(caught.value)
