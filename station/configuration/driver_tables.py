"""Tables of the configuration that are named after an installed driver, whose own model checks them."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any, ClassVar, Protocol

from pydantic import Field, GetJsonSchemaHandler, ValidationError, WrapValidator
from pydantic_core import CoreSchema

from alignment.errors import ConfigurationError, told
from sensors.drivers.installed import DriverKind, InstalledDriver, installed_drivers
from sensors.formats import StrictModel


class Loaded(Protocol):
    """A driver, and where it came from."""

    @property
    def installed(self) -> InstalledDriver:
        """Where it came from."""
        ...

    @property
    def driver(self) -> Any:
        """It has a model of its `settings`."""
        ...


class DriverTables(StrictModel):
    """A table with one table in it that is named after a driver; `tables_for` makes their fields."""

    tables: ClassVar[Mapping[str, str]] = {}
    """Field of each driver's table, by the driver's name."""
    loaded: ClassVar[Mapping[str, Any]] = {}
    """The drivers that are named, by name; without those that could not be loaded."""

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Say that exactly one of the drivers' tables stands there."""
        schema = handler.resolve_ref_schema(handler(core_schema))
        if cls.tables:
            schema["oneOf"] = [{"required": [name]} for name in cls.tables]
        return schema

    def drivers_given(self) -> list[str]:
        """Names of the drivers whose tables are there."""
        return [name for name, field in self.tables.items() if getattr(self, field) is not None]

    @property
    def driver(self) -> str:
        """Name of the driver."""
        return self.drivers_given()[0]

    @property
    def options(self) -> StrictModel:
        """The settings of that driver, an instance of its model."""
        options = getattr(self, self.tables[self.driver])
        assert isinstance(options, StrictModel)
        return options


def tables_named(tables: object, kind: DriverKind, others: Collection[str]) -> set[str]:
    """Return the drivers that tables of a file name, whose form is not known to be right yet.

    Parameters
    ----------
    tables
        A list of tables, if it is right.
    kind
        Of the drivers.
    others
        What else may stand in such a table.
    """
    known = {one.name for one in installed_drivers(kind)}
    listed = [each for each in tables if isinstance(each, dict)] if isinstance(tables, list | tuple) else []
    return {
        key
        for table in listed
        for key, value in table.items()
        if key not in others and (key in known or isinstance(value, dict))
    }


def tables_for(
    named: Collection[str], kind: DriverKind, load: Callable[[str], Loaded], described: str
) -> tuple[dict[str, str], dict[str, Any], dict[str, Any]]:
    """Return `DriverTables.tables`, `DriverTables.loaded`, and the fields of the model.

    Parameters
    ----------
    named
        Drivers that are used; they are imported. One that cannot be loaded is a mistake of the field that
        names it, so that it is told with all other mistakes of the file.
    kind
        Of the drivers.
    load
        Imports one.
    described
        What a table says, before the driver's name.
    """
    loaded: dict[str, Any] = {}
    tables: dict[str, str] = {}
    fields: dict[str, Any] = {}
    for number, name in enumerate(sorted({one.name for one in installed_drivers(kind)} | set(named))):
        model: Any = StrictModel
        text = f"Settings of this {kind.called}"
        if name in named:
            try:
                loaded[name] = load(name)
                model = _table(loaded[name])
                text = f"{described} {loaded[name].installed}"
            except ConfigurationError as error:
                model = Annotated[StrictModel, WrapValidator(_refusal(error))]
        # Named by number: what a package calls its driver need not be a name in Python.
        tables[name] = f"driver_{number}"
        fields[tables[name]] = (model | None, Field(default=None, alias=name, description=text))
    return tables, loaded, fields


def _table(loaded: Loaded) -> Any:
    """Return the type of a driver's table: its model, and one clear error when its code fails."""
    settings: type[StrictModel] = loaded.driver.settings

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
    """Return a validator that tells the error once, however many tables name the driver."""
    told = False

    def refuse(value: object, handler: object) -> StrictModel:
        nonlocal told
        if not told:
            told = True
            raise error
        return StrictModel()

    return refuse
