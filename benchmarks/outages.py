"""Programs that are killed and power that goes, many times: what was acknowledged stays, once and in order.

    python -m benchmarks.outages [--rounds N] [--engine sqlite|postgresql|both] [--json]

- writers: one after the other is killed (SIGKILL) at any moment of its commits;
- shippers: the same between a station's own database and a central one;
- power: the files of a station's database as a disk may hold them when the power goes: the end of a write
  torn, pages of an unfinished checkpoint old or new.

PostgreSQL is a server of its own with fsync on. Exit status 1 when anything was lost, doubled, out of order
or damaged.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import select
import shutil
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from datetime import timedelta
from pathlib import Path
from uuid import UUID

from sqlalchemy import func
from sqlalchemy import select as select_rows
from sqlalchemy.exc import DatabaseError

from alignment.errors import StoreError
from benchmarks.database_plant import END, STATIONS, WHEELS, calibration_id, new_cycle
from benchmarks.postgres_server import binaries, postgres_server, temporary_folder
from db.connection import make_engine, migrate, parse_url
from db.records import CalibrationRecord
from db.schema import cycles, wheel_results
from db.store import ResultStore
from db.upkeep import Shipper, check_database

STATION = STATIONS[0]
SEED = 1
# A new database now and then keeps the copies small.
_ROUNDS_EACH = 100


@dataclass(frozen=True)
class Outcome:
    """What was found after many bad moments.

    Attributes
    ----------
    acknowledged
        Cycles whose write had returned, or that were to be shipped.
    stored
        Cycles that are there; each bad moment may leave one more that was committed and not acknowledged.
    lost, doubled, disordered
        Acknowledged cycles that are not there, are there twice, or come in another order.
    damaged
        Half cycles, and findings of `truewheel db check`.
    """

    name: str
    rounds: int
    acknowledged: int
    stored: int
    lost: int
    doubled: int
    disordered: int
    damaged: int

    @property
    def good(self) -> bool:
        """Whether nothing is wrong."""
        return not (self.lost or self.doubled or self.disordered or self.damaged)


def judge(name: str, rounds: int, acknowledged: Sequence[str], url: str) -> Outcome:
    """Compare what was acknowledged, in its order, with what the database holds and says of itself."""
    try:
        stored, damaged = read_back(url)
        damaged += len(check_database(url).findings)
    except (StoreError, DatabaseError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return Outcome(name, rounds, len(acknowledged), 0, len(acknowledged), 0, 0, 1)
    found = set(stored)
    mine = [uuid for uuid in stored if uuid in set(acknowledged)]
    kept = [uuid for uuid in acknowledged if uuid in found]
    disordered = sum(left != right for left, right in zip(mine, kept, strict=False))
    return Outcome(
        name, rounds, len(acknowledged), len(stored), len(acknowledged) - len(kept),
        len(stored) - len(found), disordered, damaged,
    )  # fmt: skip


def read_back(url: str) -> tuple[list[str], int]:
    """UUIDs of the stored cycles in the order of storing, and how many wheels they have too few or many."""
    engine = make_engine(parse_url(url), timeout_s=30.0)
    with engine.connect() as connection:
        uuids = [
            uuid.hex
            for uuid in connection.execute(select_rows(cycles.c.uuid).order_by(cycles.c.id)).scalars()
        ]
        wheels = connection.execute(select_rows(func.count()).select_from(wheel_results)).scalar_one()
    engine.dispose()
    return uuids, abs(len(WHEELS) * len(uuids) - wheels)


def prepare(url: str) -> str:
    """Make the database of a station; return its URL."""
    migrate(url)
    with ResultStore(url) as store:
        for wheel in WHEELS:
            used = calibration_id(STATION, wheel)
            store.record_calibration(CalibrationRecord(used, wheel, END - timedelta(days=1), {}))
    return url


def fork(work: Callable[[int], None]) -> tuple[int, int]:
    """Run `work` in a program of its own until it is killed; return its id and what it writes to.

    A fork starts in a millisecond. SQLite does not survive one, so nothing is open meanwhile.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            work(writing)
        finally:
            os._exit(1)
    os.close(writing)
    return child, reading


def write_until_killed(url: str, acknowledged: int) -> None:
    """Write cycles, and tell the UUID of each when its write has returned."""
    number = 0
    with ResultStore(url, timeout_s=30.0) as store:
        while True:
            record = new_cycle(STATION, number)
            store.write_cycle(record)
            os.write(acknowledged, record.uuid.bytes)
            number += 1


def uuids_of(told: bytes) -> list[str]:
    """The UUIDs that a writer told."""
    return [UUID(bytes=told[start : start + 16]).hex for start in range(0, len(told), 16)]


def rest_of(reading: int) -> bytes:
    """What a program that writes no more had told."""
    told = b""
    while select.select([reading], [], [], 0.0)[0] and (part := os.read(reading, 4096)):
        told += part
    return told


def killed_writers(url: str, rounds: int) -> Outcome:
    """Kill writers in the middle of their commits."""
    moments = random.Random(SEED)
    acknowledged: list[str] = []
    for _ in range(rounds):
        writer, reading = fork(lambda told: write_until_killed(url, told))
        told = b"".join(os.read(reading, 16) for _ in range(moments.randint(1, 6)))
        # A moment anywhere in the next commit: cut short only when that commit ends first.
        select.select([], [], [], moments.uniform(0.0, 0.01))
        os.kill(writer, signal.SIGKILL)
        os.waitpid(writer, 0)
        acknowledged += uuids_of(told + rest_of(reading))
        os.close(reading)
    return judge("writers killed", rounds, acknowledged, url)


def killed_shippers(local: str, central: str, rounds: int) -> Outcome:
    """Kill shippers in the middle of their work while cycles go on; judge the central database in the end."""

    def ship_until_killed(begun: int) -> None:
        with Shipper(local, central, STATION, timeout_s=30.0, lease_s=0.0) as shipper:
            shipper.ship(1)
            os.write(begun, b"x")
            while True:
                shipper.ship(3)

    moments = random.Random(SEED)
    written: list[str] = []
    for number in range(rounds):
        records = [new_cycle(STATION, 10 * number + k) for k in range(4)]
        with ResultStore(local) as store:
            for record in records:
                store.write_cycle(record)
        written += [record.uuid.hex for record in records]
        shipper, reading = fork(ship_until_killed)
        os.read(reading, 1)
        select.select([], [], [], moments.uniform(0.0, 0.02))
        os.kill(shipper, signal.SIGKILL)
        os.waitpid(shipper, 0)
        os.close(reading)
    with Shipper(local, central, STATION, lease_s=0.0) as last:
        while last.ship().pending:
            pass
    return judge("shippers killed", rounds, written, central)


def power_lost(folder: Path, rounds: int) -> Outcome:
    """Take the files of a working station at a moment, tear them as a disk may, and read what is left."""
    moments = random.Random(SEED)
    parts = []
    for first in range(0, rounds, _ROUNDS_EACH):
        place = folder / f"power_{first}"
        place.mkdir()
        parts.append(_power_lost(place, min(_ROUNDS_EACH, rounds - first), moments))
        shutil.rmtree(place)
    sums = [sum(values) for values in zip(*(list(asdict(part).values())[1:] for part in parts), strict=True)]
    return Outcome("power lost", *sums)


def _power_lost(folder: Path, rounds: int, moments: random.Random) -> Outcome:
    path = folder / "station.db"
    url = prepare(f"sqlite:///{path}")
    writer, reading = fork(lambda told: write_until_killed(url, told))
    acknowledged: list[str] = []
    before = _Files(b"", b"")
    lost = doubled = disordered = damaged = stored = 0
    try:
        for _ in range(rounds):
            told = b"".join(os.read(reading, 16) for _ in range(moments.randint(1, 8)))
            select.select([], [], [], moments.uniform(0.0, 0.003))
            os.kill(writer, signal.SIGSTOP)
            os.waitpid(writer, os.WUNTRACED)
            acknowledged += uuids_of(told + rest_of(reading))
            now = _Files(path.read_bytes(), path.with_name(f"{path.name}-wal").read_bytes())
            copy = f"sqlite:///{now.torn(before, moments).write(folder)}"
            found = judge("power lost", 1, acknowledged, copy)
            if found.stored > found.acknowledged and now.database == before.database:
                # The last one had not returned, and nothing of it is in the database, before which the log
                # would have been synchronised: the disk may hold any part of it, or nothing.
                copy = f"sqlite:///{now.without_the_last(moments).write(folder)}"
                found = judge("power lost", 1, acknowledged, copy)
            lost, doubled = lost + found.lost, doubled + found.doubled
            disordered, damaged = disordered + found.disordered, damaged + found.damaged
            stored, before = found.stored, now
            os.kill(writer, signal.SIGCONT)
    finally:
        os.kill(writer, signal.SIGKILL)
        os.waitpid(writer, 0)
        os.close(reading)
    return Outcome("power lost", rounds, len(acknowledged), stored, lost, doubled, disordered, damaged)


@dataclass(frozen=True)
class _Files:
    """An SQLite database and its write-ahead log at a moment."""

    database: bytes
    log: bytes

    @property
    def _salts(self) -> bytes:
        # New ones whenever the log begins anew.
        return self.log[16:24]

    @property
    def _commits(self) -> list[int]:
        """Where each transaction of the log ends."""
        if len(self.log) < 32:
            return []
        frame = 24 + int.from_bytes(self.log[8:12], "big")
        ends, position = [], 32
        while position + frame <= len(self.log):
            header = self.log[position : position + 24]
            if header[8:16] != self._salts:
                break
            position += frame
            # Only the last frame of a transaction names the size of the database.
            if header[4:8] != bytes(4):
                ends.append(position)
        return ends

    def torn(self, before: _Files, moments: random.Random) -> _Files:
        """As a disk may hold it that kept what was synchronised, and any part of what came later."""
        database = self.database
        if self._salts == before._salts and before.database:
            # Whatever was copied from this log into the database may have come there or not.
            size = int.from_bytes(database[16:18], "big") or 512
            size = 65_536 if size == 1 else size
            pages = [
                moments.choice((self.database, before.database.ljust(len(database), b"\0")))[k : k + size]
                for k in range(0, len(database), size)
            ]
            database = b"".join(pages)
        ends = self._commits
        if not ends:
            return _Files(database, self.log)
        rest = self.log[ends[-1] :]
        garbage = moments.randbytes(moments.randint(0, 9000))
        tail = moments.choice((b"", garbage, rest[: moments.randint(0, len(rest))], rest + garbage))
        return _Files(database, self.log[: ends[-1]] + tail)

    def without_the_last(self, moments: random.Random) -> _Files:
        """Of the last transaction only a part."""
        ends = self._commits
        if len(ends) < 2:
            return self
        return _Files(self.database, self.log[: moments.randint(ends[-2], ends[-1] - 1)])

    def write(self, folder: Path) -> Path:
        """Write them as the files of a database that was found after the power came back."""
        path = folder / "found.db"
        for file in folder.glob(f"{path.name}*"):
            file.unlink()
        path.write_bytes(self.database)
        path.with_name(f"{path.name}-wal").write_bytes(self.log)
        return path


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all of it; 1 when anything went wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=1000, help="of each bad moment")
    parser.add_argument("--engine", choices=["sqlite", "postgresql", "both"], default="both")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args(arguments)
    results: dict[str, Outcome] = {}

    def run(engine: str, make: Callable[[], Outcome]) -> None:
        started = time.monotonic()
        outcome = make()
        results[f"{engine} {outcome.name}"] = outcome
        if not given.json:
            print(
                f"{engine:10} {outcome.name:16} {outcome.rounds:5} times: {outcome.acknowledged} cycles"
                f" acknowledged, {outcome.stored} stored, {outcome.lost} lost, {outcome.doubled} doubled,"
                f" {outcome.disordered} out of order, {outcome.damaged} damaged"
                f" ({time.monotonic() - started:.0f} s)",
                flush=True,
            )

    with ExitStack() as stack:
        folder = temporary_folder()
        stack.callback(shutil.rmtree, folder)
        folder.chmod(0o755)

        def file(name: str) -> str:
            return prepare(f"sqlite:///{folder / name}.db")

        if given.engine in ("sqlite", "both"):
            run("sqlite", lambda: killed_writers(file("writers"), given.rounds))
            run("sqlite", lambda: power_lost(folder, given.rounds))
        if given.engine in ("postgresql", "both"):
            programs = binaries()
            if programs is None:
                print("PostgreSQL is not installed (Debian: apt-get install postgresql)", file=sys.stderr)
                return 2
            own = folder / "postgresql"
            own.mkdir()
            server = stack.enter_context(postgres_server(own, programs, ["-c fsync=on"]))
            first, second = (stack.enter_context(server.database()) for _ in range(2))
            run("postgresql", lambda: killed_writers(prepare(first), given.rounds))
            migrate(second)
            run("postgresql", lambda: killed_shippers(file("shippers"), second, given.rounds))
    if given.json:
        figures = {
            f"{name} {figure}": value
            for name, outcome in results.items()
            for figure, value in asdict(outcome).items()
            if figure != "name"
        }
        print(json.dumps({"figures": figures, "good": all(one.good for one in results.values())}, indent=2))
    return 0 if all(one.good for one in results.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
