"""The rigs of a station: what all have, and one table that says what drives their cameras.

The kinds of that table are the installed camera drivers, so the model of a rig is made when it is needed:
only drivers that a configuration names are imported.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Any

from pydantic import Field, create_model, model_validator

from alignment.errors import DegenerateInputError
from alignment.values import Side
from sensors.drivers.driver import RigDriver
from sensors.drivers.installed import CAMERAS, LoadedDriver, load_driver
from sensors.formats import FilePath, Name
from station.configuration.driver_tables import DriverTables, tables_for, tables_named
from station.configuration.projectors import ProjectorSettings, projector_model

WheelName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,30}_(left|right)$")]
MOST_RIGS = 16
"""Of rigs of a station."""


class RigSettings(DriverTables):
    """The heads that look at one wheel; their number and names stand in the calibration.

    What drives the cameras is a table named after its driver, for which `rig_model` adds the fields.
    """

    name: WheelName = Field(
        description="Position of the wheel, an axle and a side, such as front_left; shots and calibrations"
        " name the same"
    )
    calibration: FilePath | None = Field(
        default=None, description="Calibration file; a simulated rig without one knows its true cameras"
    )
    heads: tuple[Name, ...] | None = Field(
        default=None,
        min_length=1,
        max_length=16,
        description="Names of the heads of a rig that is not calibrated yet, to show and capture with its"
        " cameras; afterwards the calibration names them",
    )
    projector: ProjectorSettings | None = Field(
        default=None, description="The light of this rig; none for one that is lit on its own"
    )

    @model_validator(mode="after")
    def _has_one_driver(self) -> RigSettings:
        drivers = self.drivers_given()
        if len(drivers) != 1:
            raise DegenerateInputError(
                expected="one table that says what drives the cameras, named after an installed driver: "
                + ", ".join(self.tables),
                seen=" and ".join(drivers) or "none",
            )
        if self.calibration is not None and self.heads is not None:
            raise DegenerateInputError(
                field="heads",
                expected="none beside the calibration, which names them",
                seen="both",
                cure="Leave the heads out now that the rig is calibrated",
            )
        if self.heads is not None and len(set(self.heads)) < len(self.heads):
            raise DegenerateInputError(field="heads", expected="different names", seen=", ".join(self.heads))
        if self.calibration is None and self.heads is None and not self.knows_calibration:
            raise DegenerateInputError(
                field="calibration",
                expected="the calibration file of this rig, or the names of its heads until there is one",
                seen="none",
            )
        return self

    @property
    def knows_calibration(self) -> bool:
        """Whether the driver knows the calibration without a file; also where it could not be loaded."""
        loaded = self.loaded.get(self.driver)
        return loaded is None or (
            isinstance(loaded.driver, RigDriver) and loaded.driver.calibration is not None
        )

    @property
    def cameras(self) -> LoadedDriver:
        """What drives the cameras."""
        loaded: LoadedDriver = self.loaded[self.driver]
        return loaded

    @property
    def axle(self) -> str:
        """The axle, such as ``front``."""
        return self.name.rpartition("_")[0]

    @property
    def side(self) -> Side:
        """The side of the vehicle."""
        return "left" if self.name.endswith("_left") else "right"


def drivers_named(rigs: object) -> set[str]:
    """Return the names of the drivers in the rigs of a file, whose form is not known to be right yet."""
    return tables_named(rigs, CAMERAS, RigSettings.model_fields)


def rig_model(named: Collection[str], projectors: Collection[str] = ()) -> type[RigSettings]:
    """Return the model of a rig with a table for every driver, installed or named.

    Parameters
    ----------
    named, projectors
        Drivers of cameras and of projectors that are used; see `tables_for`.
    """
    tables, loaded, fields = tables_for(named, CAMERAS, load_driver, "The cameras are driven by")
    fields["projector"] = (projector_model(projectors) | None, RigSettings.model_fields["projector"])
    made: Any = create_model("RigSettings", __base__=RigSettings, **fields)
    made.tables, made.loaded = tables, loaded
    model: type[RigSettings] = made
    return model
