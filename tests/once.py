"""What is slow to make and only read afterwards: made once in a run of the tests, for all its processes.

The folder is new in every run and gone afterwards, so that nothing older than the code is ever used.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

FOLDER = "TRUEWHEEL_TEST_RUN"
"""Variable of the environment with the folder of the run, which `conftest.py` makes."""


def once(make: Callable[P, T]) -> Callable[P, T]:
    """Make `make` be called once in a run for the same arguments; other processes read what it returned.

    The value is pickled, which keeps every bit of arrays. The first process that asks makes it, others wait.
    """

    @cache
    @wraps(make)
    def made(*arguments: P.args, **named: P.kwargs) -> T:
        with _turn(make, arguments, named) as place:
            file = place / "value"
            if file.exists():
                value: T = pickle.loads(file.read_bytes())
            else:
                value = make(*arguments, **named)
                half = place / "half"
                half.write_bytes(pickle.dumps(value, pickle.HIGHEST_PROTOCOL))
                half.replace(file)
        return value

    return made


def folder_once(fill: Callable[Concatenate[Path, P], None]) -> Callable[P, Path]:
    """Make `fill` be called once in a run for the same arguments, with an empty folder; return that folder.

    Tests only read in it, or copy it.
    """

    @cache
    @wraps(fill)
    def filled(*arguments: P.args, **named: P.kwargs) -> Path:
        with _turn(fill, arguments, named) as place:
            folder = place / "folder"
            if not folder.exists():
                half = place / "half"
                if half.exists():
                    shutil.rmtree(half)
                half.mkdir()
                fill(half, *arguments, **named)
                half.replace(folder)
        return folder

    return filled


@contextmanager
def _turn(make: Callable[..., object], arguments: object, named: object) -> Iterator[Path]:
    """Yield the place of what `make` makes of these arguments, to one process at a time."""
    what = f"{make.__module__}.{make.__qualname__}{arguments!r}{named!r}"
    place = Path(os.environ[FOLDER]) / f"{make.__name__}-{hashlib.sha256(what.encode()).hexdigest()[:16]}"
    place.mkdir(exist_ok=True)
    with (place / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield place
