"""What is compiled once for all engines of a process is the same SQL; no dialect stands for another one."""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import Dialect, Select, create_engine, literal, select
from sqlalchemy.dialects import postgresql, sqlite

from tests.statements import MOST, SHARED, SharedStatements, alike


def question() -> Select[tuple[int]]:
    return select(literal(7).label("test_of_shared_statements"))


def test_a_second_engine_uses_what_was_compiled_for_the_first(tmp_path: Path) -> None:
    """Each engine compiled everything anew: half of the time in which tests ask databases."""
    for name in ("one.db", "two.db"):
        engine = create_engine(f"sqlite:///{tmp_path / name}")
        with engine.connect() as connection:
            before = len(SHARED)
            assert connection.execute(question()).scalar_one() == 7
            assert connection.execute(select(literal(8).label("test_of_shared_statements"))).scalar_one() == 8
        engine.dispose()
    assert len(SHARED) == before


def test_another_kind_of_database_or_of_answers_is_not_alike() -> None:
    first, same, newer = (sqlite.dialect() for _ in range(3))
    spoken = sqlite.dialect(json_serializer=repr)
    newer.server_version_info = (3, 20)
    assert alike(first) == alike(same)
    others: list[Dialect] = [spoken, newer, postgresql.dialect(), sqlite.dialect(paramstyle="named")]
    for other in others:
        assert alike(other) != alike(first)


def test_what_is_kept_is_bounded() -> None:
    kept = SharedStatements()
    dialect = sqlite.dialect()
    compiled = question().compile(dialect=dialect)
    for number in range(MOST + 3):
        kept[(dialect, number)] = compiled
    assert len(kept) == 3
    assert kept.get((sqlite.dialect(), MOST)) is compiled
    assert kept.get((dialect, 0)) is None
