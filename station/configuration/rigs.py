"""The rigs of a station: what all have, and one table that says what drives their cameras.

The kinds of that table are the installed camera drivers, so the model of a rig is made when it is needed:
only drivers that a configuration names are imported.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any, ClassVar

from pydantic import (
    Field,
    GetJsonSchemaHandler,
    ValidationError,
    WrapValidator,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema

from alignment.errors import ConfigurationError, DegenerateInputError, told
from alignment.values import Side
from sensors.drivers.driver import RigDriver
from sensors.drivers.installed import LoadedDriver, installed_drivers, load_driver
from sensors.formats import FilePath, StrictModel

WheelName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,30}_(left|right)$")]
MOST_RIGS = 16
"""Of rigs of a station."""


class RigSettings(StrictModel):
    """The heads that look at one wheel; their number and names stand in the calibration.

    What drives the cameras is a table named after its driver, for which `rig_model` adds the fields.
    """

    tables: ClassVar[Mapping[str, str]] = {}
    """Field of each driver's table, by the driver's name."""
    loaded: ClassVar[Mapping[str, LoadedDriver]] = {}
    """The drivers that are named, by name; without those that could not be loaded."""

    name: WheelName = Field(
        description="Position of the wheel, an axle and a side, such as front_left; shots and calibrations"
        " name the same"
    )
    calibration: FilePath | None = Field(
        default=None, description="Calibration file; a simulated rig without one knows its true cameras"
    )

    @model_validator(mode="after")
    def _has_one_driver(self) -> RigSettings:
        drivers = self._named()
        if len(drivers) != 1:
            raise DegenerateInputError(
                expected="one table that says what drives the cameras, named after an installed driver: "
                + ", ".join(self.tables),
                seen=" and ".join(drivers) or "none",
            )
        loaded = self.loaded.get(drivers[0])
        known = loaded is None or (isinstance(loaded.driver, RigDriver) and loaded.driver.calibration)
        if self.calibration is None and not known:
            raise DegenerateInputError(
                field="calibration", expected="the calibration file of this rig", seen="none"
            )
        return self

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Say that exactly one of the drivers' tables stands there."""
        schema = handler.resolve_ref_schema(handler(core_schema))
        if cls.tables:
            schema["oneOf"] = [{"required": [name]} for name in cls.tables]
        return schema

    def _named(self) -> list[str]:
        return [name for name, field in self.tables.items() if getattr(self, field) is not None]

    @property
    def driver(self) -> str:
        """Name of what drives the cameras."""
        return self._named()[0]

    @property
    def cameras(self) -> LoadedDriver:
        """What drives the cameras."""
        return self.loaded[self.driver]

    @property
    def options(self) -> StrictModel:
        """The settings of that driver, an instance of its model."""
        options = getattr(self, self.tables[self.driver])
        assert isinstance(options, StrictModel)
        return options

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
    known = {one.name for one in installed_drivers()}
    tables = [rig for rig in rigs if isinstance(rig, dict)] if isinstance(rigs, list | tuple) else []
    return {
        key
        for rig in tables
        for key, value in rig.items()
        if key not in RigSettings.model_fields and (key in known or isinstance(value, dict))
    }


def rig_model(named: Collection[str]) -> type[RigSettings]:
    """Return the model of a rig with a table for every driver, installed or named.

    Parameters
    ----------
    named
        Drivers that are used; they are imported. One that cannot be loaded is a mistake of the field that
        names it, so that it is told with all other mistakes of the file.
    """
    loaded: dict[str, LoadedDriver] = {}
    tables: dict[str, str] = {}
    fields: dict[str, Any] = {}
    for number, name in enumerate(sorted({one.name for one in installed_drivers()} | set(named))):
        kind: Any = StrictModel
        described = "Settings of this camera driver"
        if name in named:
            try:
                loaded[name] = load_driver(name)
                kind = _table(loaded[name])
                described = f"The cameras are driven by {loaded[name].installed}"
            except ConfigurationError as error:
                kind = Annotated[StrictModel, WrapValidator(_refusal(error))]
        # Named by number: what a package calls its driver need not be a name in Python.
        tables[name] = f"driver_{number}"
        fields[tables[name]] = (kind | None, Field(default=None, alias=name, description=described))
    model = create_model("RigSettings", __base__=RigSettings, **fields)
    model.tables, model.loaded = tables, loaded
    return model


def _table(loaded: LoadedDriver) -> Any:
    """Return the type of a driver's table: its model, and one clear error when its code fails."""
    settings = loaded.driver.settings

    def checked(value: Any, handler: object) -> StrictModel:
        try:
            # As the rest of the file: through JSON, where a list may stand for a tuple.
            return settings.model_validate_json(json.dumps(value))
        except (ValidationError, ConfigurationError):
            raise
        except Exception as error:
            raise ConfigurationError(
                expected=f"settings that the driver '{loaded.installed.name}' can check",
                seen=f"{told(error)} ({loaded.installed})",
                cure=f"Tell the makers of {loaded.installed.package}",
            ) from error

    return Annotated[settings, WrapValidator(checked)]


def _refusal(error: ConfigurationError) -> Callable[[Any, object], StrictModel]:
    """Return a validator that tells the error once, however many rigs name the driver."""
    told = False

    def refuse(value: object, handler: object) -> StrictModel:
        nonlocal told
        if not told:
            told = True
            raise error
        return StrictModel()

    return refuse
