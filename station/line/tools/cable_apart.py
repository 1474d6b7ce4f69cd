"""A cable in a process of its own, whose other end has a name: ``python -m station.line.tools.cable_apart``.

A station that computes takes long to hand Python's lock on; a relay beside it in the same process would keep
frames for as long. The process ends with its standard input, so also when the station is killed.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from alignment.errors import ConfigurationError, LineConnectionError
from station.line.tools.cable import SLCAN_OPTIONS, Cable
from station.line.wire import BusSettings

_START_S, _END_S = 60.0, 10.0


@contextmanager
def named_cable(plug: Path) -> Iterator[BusSettings]:
    """Lay a cable; yields how to open its first end. Another program opens the second one as `plug`.

    The name is a symbolic link, gone at the end.

    Raises
    ------
    ConfigurationError
        When something else has that name, or no link can be made there.
    LineConnectionError
        When the process of the cable does not start.
    """
    command = [sys.executable, "-m", __name__]
    # A session of its own: the signal that tells the station to end would take its line away.
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    with process, _bounded(process):
        first, second = _ends(process)
        link(plug, second)
        try:
            yield BusSettings("slcan", first, options=SLCAN_OPTIONS)
        finally:
            if plug.is_symlink() and str(plug.readlink()) == second:
                plug.unlink()


def link(plug: Path, device: str) -> None:
    """Give a device a name; one that leads nowhere was left by a program that was killed.

    Raises
    ------
    ConfigurationError
        As `named_cable`.
    """
    try:
        plug.parent.mkdir(parents=True, exist_ok=True)
        if plug.is_symlink() and not plug.exists():
            plug.unlink()
        plug.symlink_to(device)
    except OSError as error:
        there = plug.is_symlink() or plug.exists()
        raise ConfigurationError(
            file=plug,
            choice="cable",
            expected="a new name for the other end of the cable",
            seen="something of this name" if there else error.strerror or str(error),
            cure="Choose another name, or remove it if no other program has it"
            if there
            else "Choose a place that can be written",
        ) from error


@contextmanager
def _bounded(process: subprocess.Popen[str]) -> Iterator[None]:
    """End the process at the end of its standard input, or in any case after a while."""
    try:
        yield
    finally:
        assert process.stdin is not None
        process.stdin.close()
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()


def _ends(process: subprocess.Popen[str]) -> tuple[str, str]:
    assert process.stdout is not None
    bound = threading.Timer(_START_S, process.kill)
    bound.start()
    try:
        said = process.stdout.readline()
    finally:
        bound.cancel()
        bound.join()
    if not said:
        raise LineConnectionError(
            f"the process of the cable did not start within {_START_S:g} s. Start the station again, or name "
            "the interface of a bus in its configuration"
        )
    first, second = json.loads(said)
    return first, second


def main() -> None:
    """Hold a cable until standard input ends; says the names of its ends."""
    with Cable() as cable:
        print(json.dumps(cable.ends), flush=True)  # noqa: T201
        sys.stdin.buffer.read()


if __name__ == "__main__":
    main()
