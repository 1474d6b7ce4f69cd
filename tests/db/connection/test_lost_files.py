"""A database file that is deleted, moved or replaced while a station runs: no OK for what is gone."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from alignment.errors import StoreError, StoreUnavailableError
from db.connection import WatchedConnection, make_engine, migrate, parse_url
from db.store import ResultStore
from db.sums import update_sums
from db.upkeep.backups import backup
from db.upkeep.shipping import Shipper
from tests.db.example_records import CALIBRATION, cycle
from tests.db.pool import pool_of

Lose = Callable[[Path], None]


def delete(path: Path) -> None:
    path.unlink()


def move(path: Path) -> None:
    path.rename(path.with_name("elsewhere.db"))


def move_folder(path: Path) -> None:
    path.parent.rename(path.parent.with_name("moved"))


def delete_all(path: Path) -> None:
    for one in path.parent.glob(f"{path.name}*"):
        one.unlink()


def delete_wal(path: Path) -> None:
    path.with_name(f"{path.name}-wal").unlink()


def delete_shm(path: Path) -> None:
    path.with_name(f"{path.name}-shm").unlink()


def replace_by_a_copy(path: Path) -> None:
    backup(f"sqlite:///{path}", path.with_name("copy.db"))
    path.with_name("copy.db").rename(path)


def replace_by_an_empty_one(path: Path) -> None:
    delete_all(path)
    migrate(f"sqlite:///{path}")


def replace_the_wal(path: Path) -> None:
    wal = path.with_name(f"{path.name}-wal")
    shutil.copy(wal, path.with_name("wal"))
    path.with_name("wal").rename(wal)


def replace_the_folder(path: Path) -> None:
    folder = path.parent
    shutil.copytree(folder, folder.with_name("other"))
    folder.rename(folder.with_name("moved"))
    folder.with_name("other").rename(folder)


LOSSES = [
    delete,
    move,
    move_folder,
    delete_all,
    delete_wal,
    delete_shm,
    replace_by_a_copy,
    replace_by_an_empty_one,
    replace_the_wal,
    replace_the_folder,
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "station").mkdir()
    return tmp_path / "station" / "results.db"


@pytest.fixture
def running(path: Path, open_store: Callable[..., ResultStore]) -> ResultStore:
    store = open_store(f"sqlite:///{path}")
    store.record_calibration(CALIBRATION)
    store.write_cycle(cycle())
    return store


@pytest.mark.parametrize("lose", LOSSES)
def test_nothing_is_called_stored_in_a_file_that_is_gone(
    running: ResultStore, path: Path, lose: Lose
) -> None:
    """The pool went on with the file that nobody finds any more, and the next vehicles were told OK."""
    lose(path)
    for _ in range(3):
        # Not only once: the station must not go on with it, nor begin another file.
        with pytest.raises(StoreUnavailableError, match=r"was deleted or moved away|was replaced by another"):
            running.write_cycle(cycle())
        with pytest.raises(StoreError):
            running.recent_cycles(1)


@pytest.mark.parametrize("lose", [delete, replace_by_a_copy, delete_wal])
def test_a_file_lost_amid_a_commit_is_found_before_it_is_called_stored(
    running: ResultStore, path: Path, lose: Lose, monkeypatch: pytest.MonkeyPatch
) -> None:
    look, looks = WatchedConnection.look, []

    def lose_after_the_first_look(self: WatchedConnection, where: str) -> None:
        look(self, where)
        looks.append(where)
        if len(looks) == 1:
            lose(path)

    monkeypatch.setattr(WatchedConnection, "look", lose_after_the_first_look)
    with pytest.raises(StoreUnavailableError):
        running.write_cycle(cycle())


def test_a_file_that_was_put_back_is_written_again(running: ResultStore, path: Path) -> None:
    record = cycle()
    path.rename(path.with_name("away.db"))
    with pytest.raises(StoreUnavailableError, match="Put the file back"):
        running.write_cycle(record)
    path.with_name("away.db").rename(path)
    running.write_cycle(record)
    assert running.recent_cycles(1)[0].record == record


def test_a_link_that_points_elsewhere_now_is_another_file(
    tmp_path: Path, open_store: Callable[..., ResultStore]
) -> None:
    for name in ("a.db", "b.db"):
        migrate(f"sqlite:///{tmp_path / name}")
    link = tmp_path / "results.db"
    link.symlink_to(tmp_path / "a.db")
    store = open_store(f"sqlite:///{link}")
    store.record_calibration(CALIBRATION)
    link.unlink()
    link.symlink_to(tmp_path / "b.db")
    with pytest.raises(StoreUnavailableError, match=r"results\.db was replaced by another file"):
        store.write_cycle(cycle())


def test_a_new_connection_does_not_take_the_file_that_stands_there_now(
    running: ResultStore, path: Path
) -> None:
    replace_by_an_empty_one(path)
    # As after an error that closed all connections.
    pool_of(running).dispose()
    with pytest.raises(StoreUnavailableError, match="was replaced by another file"):
        running.write_cycle(cycle())
    delete_all(path)
    pool_of(running).dispose()
    with pytest.raises(StoreUnavailableError):
        running.write_cycle(cycle())
    assert not path.exists()


def test_what_is_lost_is_neither_shipped_nor_summed(running: ResultStore, path: Path, tmp_path: Path) -> None:
    migrate(central := f"sqlite:///{tmp_path / 'central.db'}")
    engine = make_engine(parse_url(f"sqlite:///{path}"), timeout_s=5.0)
    with Shipper(f"sqlite:///{path}", central, "EOL-1") as shipper:
        assert shipper.ship().shipped == 2
        assert update_sums(engine) == 1
        running.write_cycle(cycle())
        replace_by_an_empty_one(path)
        for work in (shipper.ship, shipper.pending, lambda: update_sums(engine)):
            with pytest.raises(StoreUnavailableError):
                work()
    engine.dispose()
