"""Each statement is compiled to SQL once in a process of the run, not once for each engine that a test opens.

A program opens a database or two, tests open thousands: compiling took half of the time of their questions.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

from sqlalchemy import Compiled, Connection, Dialect, Engine, event

MOST = 5000
"""Statements kept; after so many it begins anew."""


def alike(dialect: Dialect) -> Hashable:
    """What two dialects must have in common to compile a statement to the same SQL."""
    return (
        type(dialect),
        dialect.paramstyle,
        getattr(dialect, "server_version_info", None),
        dialect.insert_returning,
        dialect.update_returning,
        dialect.delete_returning,
        getattr(dialect, "use_insertmanyvalues", None),
        getattr(dialect, "_json_serializer", None),
        getattr(dialect, "_json_deserializer", None),
    )


class SharedStatements(dict[Any, Compiled]):
    """Compiled statements by what SQLAlchemy asks: a dialect and the statement's own key.

    Dialects that are alike stand for each other.
    """

    def get(self, key: tuple[Any, ...], default: Any = None) -> Any:
        return super().get((alike(key[0]), *key[1:]), default)

    def __setitem__(self, key: tuple[Any, ...], value: Compiled) -> None:
        if len(self) >= MOST:
            self.clear()
        super().__setitem__((alike(key[0]), *key[1:]), value)


SHARED = SharedStatements()


def share() -> None:
    """Let every connection of every engine of this process use what was compiled for another one."""

    @event.listens_for(Engine, "engine_connect")
    def _shared(connection: Connection) -> None:
        connection.execution_options(compiled_cache=SHARED)
