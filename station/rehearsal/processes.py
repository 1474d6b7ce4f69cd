"""Starts, watches and ends the processes of a rehearsal."""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from alignment.errors import LineTimeoutError
from station.rehearsal.nursery import Copy, Nursery

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

START_S, END_S = 60.0, 30.0
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


class RehearsalProcess:
    """A module of this package that runs as a process, is told its order, and says when it is ready.

    Parameters
    ----------
    module
        Its name.
    order
        What it is told, as JSON on its command line.
    nursery
        What makes it from a process that has loaded the module; None for one that loads it itself.

    Raises
    ------
    LineTimeoutError
        When it is not ready in time; what it wrote on standard error is there to read.
    """

    def __init__(self, module: str, order: DataclassInstance, nursery: Nursery | None = None) -> None:
        told = json.dumps(asdict(order))
        self._process: subprocess.Popen[bytes] | Copy = (
            nursery.start(module, told)
            if nursery is not None
            else subprocess.Popen(
                [sys.executable, "-m", module, told],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                cwd=Path(__file__).resolve().parents[2],
            )
        )
        assert self._process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            said = bool(selector.select(START_S)) and self._process.stdout.readline() == b"ready\n"
        if not said:
            self.kill()
            raise LineTimeoutError(f"expected {module} to be ready within {START_S:g} s, but it is not")

    @property
    def rss_mb(self) -> float:
        """Memory that it has in use now, megabytes."""
        return rss_mb(self._process.pid)

    @property
    def ended(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    def wait(self, timeout_s: float = END_S) -> int:
        """Wait for its end; its exit status, negative for a signal.

        Raises
        ------
        LineTimeoutError
            When it does not end in time.
        """
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise LineTimeoutError(
                f"process {self._process.pid} did not end within {timeout_s:g} s"
            ) from error
        finally:
            self._close_pipes()

    def end(self) -> int:
        """Tell it to end, and wait; its exit status."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        return self.wait()

    def kill(self) -> None:
        """End it at once, wherever it is."""
        self._process.kill()
        self._process.wait(END_S)
        self._close_pipes()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.ended:
            self._close_pipes()
        elif error is None:
            self.end()
        else:
            self.kill()

    def _close_pipes(self) -> None:
        if isinstance(self._process, Copy):
            self._process.close()
            return
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()


def rss_mb(pid: int | str = "self") -> float:
    """Memory that a process has in use now, megabytes."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * _PAGE_BYTES / 1e6


def read_lines(file: Path) -> list[dict[str, Any]]:
    """All JSON lines of a report; an unfinished last line does not count."""
    if not file.exists():
        return []
    text = file.read_text(encoding="utf-8")
    return [json.loads(line) for line in text.split("\n")[:-1]]
