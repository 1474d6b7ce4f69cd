"""Start writers one after the other and kill each in the middle of its commits.

Usage: python -m tests.db.kill_writer URL KILLS SEED. Prints the UUID of every cycle whose write had returned.
A program of its own, because it forks: that starts a writer in a millisecond.
"""

import os
import random
import select
import signal
import sys
from uuid import UUID

from db.store import ResultStore
from tests.db.example_records import cycle


def write_until_killed(url: str, acknowledged: int) -> None:
    with ResultStore(url) as store:
        while True:
            record = cycle()
            store.write_cycle(record)
            os.write(acknowledged, record.uuid.bytes)


def acknowledged_before_kill(url: str, random_moment: random.Random) -> bytes:
    reading, writing = os.pipe()
    writer = os.fork()
    if writer == 0:
        try:
            write_until_killed(url, writing)
        finally:
            os._exit(1)
    os.close(writing)
    acknowledged = b""
    for _ in range(random_moment.randint(1, 6)):
        acknowledged += os.read(reading, 16)
    # A moment anywhere in the next commit: cut short only when that commit ends first.
    select.select([], [], [], random_moment.uniform(0.0, 0.01))
    os.kill(writer, signal.SIGKILL)
    os.waitpid(writer, 0)
    while rest := os.read(reading, 4096):
        acknowledged += rest
    os.close(reading)
    return acknowledged


if __name__ == "__main__":
    url, kills, seed = sys.argv[1:]
    moments = random.Random(int(seed))
    for _ in range(int(kills)):
        found = acknowledged_before_kill(url, moments)
        for start in range(0, len(found), 16):
            print(UUID(bytes=found[start : start + 16]))
