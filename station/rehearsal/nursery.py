"""A process that has loaded what the processes of a rehearsal need, and makes each of them a copy of itself.

Loading takes a process two seconds, and a rehearsal starts hundreds. Every copy is a process of its own: it
can be killed at any place, and nothing of it is left for the next. Run as ``python -m`` with the number of
its socket and the modules to load.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self

from alignment.errors import LineError

_ORDER_BYTES = 65_536
_STREAMS = 3  # standard input and output of a copy, and where its end is told


class Nursery:
    """Starts processes that run the `main` of one of some modules.

    Parameters
    ----------
    modules
        What is loaded once for all of them.
    """

    def __init__(self, *modules: str) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(theirs.fileno()), *modules],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                cwd=Path(__file__).resolve().parents[2],
            )

    def start(self, module: str, order: str) -> Copy:
        """Start a process; what it is told is on its command line."""
        stdin, to_stdin = os.pipe()
        from_stdout, stdout = os.pipe()
        told, tell = os.pipe()
        socket.send_fds(self._socket, [json.dumps([module, order]).encode()], [stdin, stdout, tell])
        for end in (stdin, stdout, tell):
            os.close(end)
        return Copy(to_stdin, from_stdout, told)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()
        self._process.wait()


class Copy:
    """A process that a nursery started: as much of `subprocess.Popen` as a rehearsal uses.

    Attributes
    ----------
    stdin, stdout
        Its pipes.
    returncode
        Its exit status, negative for a signal; None while it runs.
    """

    def __init__(self, stdin: int, stdout: int, told: int) -> None:
        self.stdin = os.fdopen(stdin, "wb", buffering=0)
        self.stdout = os.fdopen(stdout, "rb")
        self.returncode: int | None = None
        self._told = os.fdopen(told, "rb")
        self._pid: int | None = None

    @property
    def pid(self) -> int:
        """Its process id."""
        if self._pid is None:
            line = self._told.readline()
            if not line:
                raise LineError("expected the nursery to start a process, but it has ended")
            self._pid = int(line)
        return self._pid

    def poll(self) -> int | None:
        """Exit status, or None while it runs."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout: float) -> int:
        """Wait for its end; its exit status.

        Raises
        ------
        subprocess.TimeoutExpired
            When it does not end in so many seconds.
        """
        if self.returncode is None:
            pid = self.pid
            with selectors.DefaultSelector() as selector:
                selector.register(self._told, selectors.EVENT_READ)
                if not selector.select(timeout):
                    raise subprocess.TimeoutExpired(str(pid), timeout)
            self.returncode = int(self._told.readline())
        return self.returncode

    def kill(self) -> None:
        """End it at once, wherever it is."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)

    def close(self) -> None:
        """Close its pipes."""
        for stream in (self.stdin, self.stdout, self._told):
            stream.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _serve(orders: socket.socket) -> None:
    """Make a copy for every order, until nobody can order any more."""
    # Nobody waits for those who watch: they are gone with their end.
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        message, streams, _, _ = socket.recv_fds(orders, _ORDER_BYTES, _STREAMS)
        if not message:
            return
        if os.fork() == 0:
            orders.close()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            _watch(*json.loads(message), *streams)
        for stream in streams:
            os.close(stream)


def _watch(module: str, order: str, stdin: int, stdout: int, tell: int) -> None:
    """Make the copy, tell its process id and, when it has ended, its exit status."""
    copy = os.fork()
    if copy == 0:
        os.close(tell)
        for stream, place in ((stdin, 0), (stdout, 1)):
            os.dup2(stream, place)
            os.close(stream)
        sys.argv = [module, order]
        # As at the end of any program: what it left to be flushed is, and an error has its own status.
        importlib.import_module(module).main()
        sys.exit(0)
    os.close(stdin)
    os.close(stdout)
    os.write(tell, b"%d\n" % copy)
    _, status = os.waitpid(copy, 0)
    os.write(tell, b"%d\n" % os.waitstatus_to_exitcode(status))
    os._exit(0)


def main() -> None:
    """Load the modules, then serve."""
    for module in sys.argv[2:]:
        importlib.import_module(module)
    with socket.socket(fileno=int(sys.argv[1])) as orders:
        _serve(orders)


if __name__ == "__main__":
    main()
