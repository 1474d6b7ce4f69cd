"""The connections of a store, as only tests of lost and counted ones touch them."""

from __future__ import annotations

from sqlalchemy import Engine

from db.store import ResultStore


def pool_of(store: ResultStore) -> Engine:
    """The engine of an open store."""
    assert store._engine is not None
    return store._engine
