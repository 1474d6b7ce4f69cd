"""Start shippers one after the other and kill each in the middle of its work.

Usage: python -m tests.db.kill_shipper LOCAL CENTRAL KILLS SEED. Cycles are written meanwhile; prints their
UUIDs in the order of storing. A program of its own, because it forks: that starts a shipper in a millisecond.
"""

import os
import random
import select
import signal
import sys

from db.shipping import Shipper
from db.store import ResultStore
from tests.db.example_records import cycle


def ship_until_killed(local: str, central: str, begun: int) -> None:
    with Shipper(local, central, "EOL-1", lease_s=0.0) as shipper:
        shipper.ship(1)
        os.write(begun, b"x")
        while True:
            shipper.ship(3)


def kill_one(local: str, central: str, random_moment: random.Random) -> None:
    reading, writing = os.pipe()
    shipper = os.fork()
    if shipper == 0:
        try:
            ship_until_killed(local, central, writing)
        finally:
            os._exit(1)
    os.close(writing)
    os.read(reading, 1)
    os.close(reading)
    # A moment anywhere in the next shipments.
    select.select([], [], [], random_moment.uniform(0.0, 0.02))
    os.kill(shipper, signal.SIGKILL)
    os.waitpid(shipper, 0)


if __name__ == "__main__":
    local, central, kills, seed = sys.argv[1:]
    moments = random.Random(int(seed))
    for _ in range(int(kills)):
        records = [cycle() for _ in range(4)]
        # Closed before the fork: SQLite does not survive one.
        with ResultStore(local) as store:
            for record in records:
                store.write_cycle(record)
        for record in records:
            print(record.uuid.hex)
        kill_one(local, central, moments)
