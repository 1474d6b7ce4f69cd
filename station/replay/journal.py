"""What is measured already, one line for each folder: a run that is killed goes on where it stopped."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

from alignment.errors import ConfigurationError, FormatError
from sensors.formats import open_ordinary
from station.replay.values import Choices, Replayed, ReplayState

SCHEMA = "truewheel.replay-journal/1"
_LARGEST = 2**40
_CURE = "Choose another journal, or delete this one to begin anew"


def identity(archive: Path, choices: Choices, selection: Mapping[str, Any], program: str) -> dict[str, Any]:
    """Return what a journal is of: another archive, other choices or another program need another journal.

    Parameters
    ----------
    archive
        What is replayed.
    choices
        Of the measurement.
    selection
        Which folders, and which database: plain values.
    program
        Its version and the hash of its mathematics.
    """
    chosen = {
        "calibrations": {rig: _digest(document) for rig, document in sorted(choices.calibrations.items())},
        "settings": None if choices.settings is None else vars(choices.settings),
        "within": choices.within,
        **selection,
    }
    return {
        "schema": SCHEMA, "archive": str(archive.resolve()), "choices": _digest(chosen), "program": program,
    }  # fmt: skip


def own_place(of: Mapping[str, Any]) -> Path:
    """Return where the journal of a replay is kept when nobody says where: the user's folder for states."""
    states = os.environ.get("XDG_STATE_HOME") or "~/.local/state"
    return Path(states).expanduser() / "truewheel" / "replay" / f"{_digest(of)[:32]}.jsonl"


class Journal:
    """A file of lines; entered, it belongs to one process alone.

    Parameters
    ----------
    path
        Made when it is missing.
    of
        As `identity` gives it.
    anew
        Forget what it holds.

    Raises
    ------
    ConfigurationError
        On entering: when it cannot be written, is of another replay, no journal, or another process has it.
    """

    def __init__(self, path: Path, of: Mapping[str, Any], *, anew: bool = False) -> None:
        self.path = path
        self._of = dict(of)
        self._anew = anew
        self._file: BinaryIO | None = None

    def __enter__(self) -> Self:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            # An ordinary file or none: opening a pipe would wait for ever.
            if self.path.exists():
                open_ordinary(self.path, "a journal", _LARGEST).close()
            self._file = self.path.open("a+b")
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._close()
            raise self._refused("a journal that nobody uses", "one of a replay that runs") from error
        except FormatError as error:
            raise self._refused(error.expected, error.seen or "another kind of file") from error
        except OSError as error:
            self._close()
            raise self._refused("a file that can be written", error.strerror or str(error)) from error
        try:
            self._begin()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def entries(self, seen: set[str] | None = None) -> Iterator[Replayed]:
        """Yield what it holds, each folder once; not those that failed, which are tried again.

        The keys of the others are added to `seen`.
        """
        seen = set() if seen is None else seen
        for line in self._lines():
            try:
                found = Replayed.of(json.loads(line))
            except (ValueError, TypeError, KeyError, AttributeError) as error:
                raise self._refused("lines that a replay wrote", f"another one: {line[:60]!r}") from error
            if found.key not in seen and found.state is not ReplayState.FAILED:
                seen.add(found.key)
                yield found

    def add(self, done: Replayed) -> None:
        """Write what came of a folder; it stays, whatever becomes of this process."""
        assert self._file is not None
        self._file.write(json.dumps(done.plain(), ensure_ascii=True, allow_nan=False).encode() + b"\n")
        self._file.flush()

    def remove(self) -> None:
        """Delete it."""
        self.path.unlink(missing_ok=True)

    def _begin(self) -> None:
        assert self._file is not None
        if self._anew:
            self._file.truncate(0)
        whole = self._whole_bytes()
        # What a process was writing when it was killed.
        self._file.truncate(whole)
        if whole == 0:
            self._file.write(json.dumps(self._of).encode() + b"\n")
            self._file.flush()
            return
        self._file.seek(0)
        first = self._file.readline(65_536)
        try:
            found = json.loads(first)
        except ValueError:
            found = None
        if not isinstance(found, dict) or found.get("schema") != SCHEMA:
            raise self._refused(f"a journal, {SCHEMA}", "another kind of file")
        for name, what in (
            ("archive", "archive"), ("choices", "choices"), ("program", "program"),
        ):  # fmt: skip
            if found.get(name) != self._of[name]:
                raise self._refused("the journal of this replay", f"that of another {what}")

    def _whole_bytes(self) -> int:
        """Bytes up to the end of the last whole line."""
        assert self._file is not None
        end = self._file.seek(0, os.SEEK_END)
        while end > 0:
            start = max(0, end - 65_536)
            self._file.seek(start)
            found = self._file.read(end - start).rfind(b"\n")
            if found >= 0:
                return start + found + 1
            end = start
        return 0

    def _lines(self) -> Iterator[bytes]:
        with self.path.open("rb") as stream:
            next(stream, None)
            yield from stream

    def _close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def _refused(self, expected: str, seen: str) -> ConfigurationError:
        return ConfigurationError(file=self.path, choice="journal", expected=expected, seen=seen, cure=_CURE)


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()
