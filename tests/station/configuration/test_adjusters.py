"""What can be turned on a type of vehicle: one clear mistake each."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from alignment.errors import DegenerateInputError
from station.configuration.adjusters import AxleAdjusters
from station.configuration.vehicle_types import VehicleType
from tests.station.configuration.test_bounds import NEEDED

ROD = {"toe_deg_per_turn": 0.7, "camber_deg_per_turn": 0.02, "range_turns": 4.0}
BOLT = {"camber_deg_per_turn": 0.5, "toe_deg_per_turn": 0.1, "range_turns": 1.5}


def mistake(**given: Any) -> DegenerateInputError:
    with pytest.raises(ValidationError) as caught:
        AxleAdjusters.model_validate(given)
    found = caught.value.errors()[0]["ctx"]["error"]
    assert isinstance(found, DegenerateInputError)
    return found


@pytest.mark.parametrize(
    ("field", "given"),
    [
        ("toe_deg_per_turn", {"tie_rod": ROD | {"toe_deg_per_turn": 0.0}}),
        ("toe_deg_per_turn", {"tie_rod": ROD | {"camber_deg_per_turn": 0.9}}),
        ("camber_deg_per_turn", {"camber_bolt": BOLT | {"camber_deg_per_turn": -0.5}}),
        ("camber_deg_per_turn", {"camber_bolt": BOLT | {"toe_deg_per_turn": 0.6}}),
        ("drift_deg", {"tie_rod": ROD | {"drift_deg": 0.2, "drift_bound_deg": 0.1}}),
        (
            "camber_bolt",
            {
                "tie_rod": ROD | {"camber_deg_per_turn": 0.6},
                "camber_bolt": BOLT | {"toe_deg_per_turn": 0.45},
            },
        ),
    ],
)
def test_what_sets_no_angle_of_its_own_is_refused(field: str, given: dict[str, Any]) -> None:
    assert mistake(**given).field == field


def test_a_rod_that_toes_out_when_it_is_lengthened_is_as_good() -> None:
    found = AxleAdjusters.model_validate({"tie_rod": ROD | {"toe_deg_per_turn": -0.7}})
    assert found.tie_rod is not None


def test_an_axle_without_limits_cannot_be_adjusted() -> None:
    with pytest.raises(ValidationError, match="adjusting"):
        VehicleType.model_validate(NEEDED[VehicleType] | {"adjusting": {"middle": {}}})
