"""A live view of a rig's cameras, a page for whoever mounts and focuses them.

The page holds nothing and starts nothing: it shows what the loop took last. It is served on the loopback
address alone, to a few readers at a time, and ends with the command.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socket import socket
from typing import Any

from alignment.errors import ConfigurationError, TruewheelError
from sensors.shot import WheelShot
from station.maintenance.figures import bars, figures_as_json, picture, shot_figures
from station.maintenance.opened import WorkRig
from station.maintenance.remarks import advice
from station.pages import page

LOOPBACK = "127.0.0.1"
_MOST_READERS, _REQUEST_S = 8, 10.0
_PAUSE_AFTER_FAILURE_S = 0.5


class LiveView:
    """What the page shows: the last shot's pictures and figures, or why there is none.

    Parameters
    ----------
    rig
        Name of the rig.
    cameras
        Names of its cameras.
    """

    def __init__(self, rig: str, cameras: tuple[str, ...]) -> None:
        self.rig = rig
        self.cameras = cameras
        self._lock = threading.Lock()
        self._number = 0
        self._state: dict[str, Any] = {"number": 0, "problem": "waiting for the first images", "cameras": []}
        self._pictures: tuple[bytes, ...] = ()

    def show(self, shot: WheelShot) -> None:
        """Show a shot."""
        figures = shot_figures(shot)
        pictures = tuple(picture(frame.image) for frame in shot.frames)
        listed = [figures_as_json(each) | {"bars": bars(each), "advice": advice(each)} for each in figures]
        with self._lock:
            self._number += 1
            self._pictures = pictures
            self._state = {"number": self._number, "problem": "", "cameras": listed}

    def fail(self, problem: str) -> None:
        """Show why there is no shot; the pictures before are not shown on."""
        with self._lock:
            self._number += 1
            self._pictures = ()
            self._state = {"number": self._number, "problem": problem, "cameras": []}

    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Return kind and content of what stands at a path; None where nothing does."""
        place = path.partition("?")[0]
        if place == "/":
            text = page(
                "station.maintenance", "live.html", title=f"Live: {self.rig}", cameras=list(self.cameras)
            )
            return "text/html; charset=utf-8", text.encode()
        if place == "/state.json":
            with self._lock:
                return "application/json", json.dumps(self._state, allow_nan=False).encode()
        if place.startswith("/picture/") and place.endswith(".jpg"):
            number = place.removeprefix("/picture/").removesuffix(".jpg")
            with self._lock:
                pictures = self._pictures
            if number.isascii() and number.isdigit() and len(number) < 4 and int(number) < len(pictures):
                return "image/jpeg", pictures[int(number)]
        return None


class _Server(ThreadingHTTPServer):
    """Serves a few readers at a time; more are turned away."""

    daemon_threads = True
    request_queue_size = _MOST_READERS

    def __init__(self, port: int, view: LiveView) -> None:
        self.view = view
        self._readers = threading.BoundedSemaphore(_MOST_READERS)
        super().__init__((LOOPBACK, port), _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        if not self._readers.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._readers.release()

    def handle_error(self, request: socket | tuple[bytes, socket], client_address: Any) -> None:
        """A reader who goes away amid an answer is no news."""


class _Handler(BaseHTTPRequestHandler):
    timeout = _REQUEST_S
    server: _Server

    def do_GET(self) -> None:
        """Answer with what the view holds."""
        # A page of another origin must not read the pictures by a name that leads here.
        host = self.headers.get("Host", "").rpartition(":")[0]
        found = self.server.view.answer(self.path) if host in (LOOPBACK, "localhost") else None
        if found is None:
            self.send_error(404)
            return
        kind, content = found
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Each picture that is fetched is no news."""


@contextmanager
def served(view: LiveView, port: int = 0) -> Iterator[str]:
    """Serve a live view on the loopback address; yields the page's address, ends at the end.

    Parameters
    ----------
    view
        What is shown.
    port
        0 for any that is free.

    Raises
    ------
    ConfigurationError
        When the port is taken.
    """
    try:
        server = _Server(port, view)
    except OSError as error:
        raise ConfigurationError(
            choice="port", expected="a port that is free", seen=f"{port}: {error.strerror or error}"
        ) from error
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), name="live view")
    thread.start()
    try:
        yield f"http://{LOOPBACK}:{server.server_address[1]}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def watch_cameras(
    rig: WorkRig,
    view: LiveView,
    seconds: float,
    interval_s: float = 0.2,
    clock: Callable[[], float] = time.monotonic,
    ended: threading.Event | None = None,
) -> int:
    """Shoot again and again for so long, and show each shot; return how many there were.

    A shot that fails is shown as its reason, and the cameras are armed again: whoever plugs in a cable
    sees it.
    """
    ended = ended or threading.Event()
    until_s, taken, armed = clock() + seconds, 0, False
    while not ended.is_set() and clock() < until_s:
        try:
            if not armed:
                rig.arm()
                armed = True
            view.show(rig.shoot())
            taken += 1
            pause_s = interval_s
        except TruewheelError as error:
            view.fail(str(error))
            armed, pause_s = False, _PAUSE_AFTER_FAILURE_S
        ended.wait(max(0.0, min(pause_s, until_s - clock())))
    return taken
