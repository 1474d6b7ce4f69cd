"""The projector of a rig: how bright, whether exposures without it are taken, and what drives it."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from pydantic import Field, create_model, model_validator

from alignment.errors import DegenerateInputError
from sensors.projectors import PROJECTORS, LoadedProjector, RigLight, load_projector
from station.configuration.driver_tables import DriverTables, tables_for, tables_named


class ProjectorSettings(DriverTables):
    """The light of a rig; what drives it is a table named after its driver (`projector_model`)."""

    brightness: float = Field(
        default=1.0, ge=0.01, le=1, description="Share of the projector's full light, 0.01 … 1"
    )
    dark: bool = Field(
        default=False,
        description="Every shot has a second exposure without the projector, whose light is subtracted",
    )

    @model_validator(mode="after")
    def _has_one_driver(self) -> ProjectorSettings:
        drivers = self.drivers_given()
        if len(drivers) != 1:
            raise DegenerateInputError(
                expected="one table that says what drives the projector, named after an installed driver: "
                + ", ".join(self.tables),
                seen=" and ".join(drivers) or "none",
            )
        loaded = self.loaded.get(drivers[0])
        if loaded is not None and self.dark and not loaded.driver.can_be_dark:
            raise DegenerateInputError(
                field="dark",
                expected=f"false: a projector of the driver '{drivers[0]}' cannot be switched off",
                seen="true",
                cure="Leave it out, or name the driver that switches the projector",
            )
        if loaded is not None and self.brightness != 1.0 and not loaded.driver.adjustable:
            raise DegenerateInputError(
                field="brightness",
                expected=f"none: a projector of the driver '{drivers[0]}' is as bright as it was set by hand",
                seen=f"{self.brightness:g}",
            )
        return self

    @property
    def projector(self) -> LoadedProjector:
        """What drives it."""
        loaded: LoadedProjector = self.loaded[self.driver]
        return loaded

    def light(self) -> RigLight:
        """Return the value that a rig takes."""
        return RigLight(self.brightness, self.dark)


def projectors_named(rigs: object) -> set[str]:
    """Return the drivers of projectors in the rigs of a file, whose form is not known to be right yet."""
    listed = [rig for rig in rigs if isinstance(rig, dict)] if isinstance(rigs, list | tuple) else []
    return tables_named([rig.get("projector") for rig in listed], PROJECTORS, ProjectorSettings.model_fields)


def projector_model(named: Collection[str]) -> type[ProjectorSettings]:
    """Return the model of a projector with a table for every driver, installed or named."""
    tables, loaded, fields = tables_for(named, PROJECTORS, load_projector, "The projector is driven by")
    made: Any = create_model("ProjectorSettings", __base__=ProjectorSettings, **fields)
    made.tables, made.loaded = tables, loaded
    model: type[ProjectorSettings] = made
    return model
