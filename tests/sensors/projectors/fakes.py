"""A serial projector at the other end of a pseudo-terminal, one that notes, one that hangs."""

from __future__ import annotations

import os
import threading
import tty
from collections.abc import Callable

from sensors.projectors import ProjectorState


class NotedProjector:
    """Notes what it is told."""

    can_be_dark = True

    def __init__(self, rig="front_left", log=None):
        self.rig = rig
        self.log = [] if log is None else log
        self.failing = {}

    def _do(self, what, *more):
        self.log.append((what, *more))
        if what in self.failing:
            raise self.failing[what]

    def connect(self):
        self._do("connect")

    def light(self, brightness):
        self._do("light", brightness)

    def dark(self):
        self._do("dark")

    def state(self):
        self._do("state")

    def close(self):
        self._do("close")


class Lamp:
    """What hangs on the cable, whichever driver object talks to it; a test changes it at any time.

    `hangs` names calls that hang until `go_on` is set; each one that does so sets `hanging`. `open` counts
    driver objects that are connected.
    """

    def __init__(self, rig="front_left"):
        self.rig = rig
        self.calls, self.hangs, self.raises, self.once = [], set(), {}, {}
        self.hanging, self.go_on = threading.Event(), threading.Event()
        self.made, self.open, self.share, self.answer = 0, 0, None, ProjectorState("lamp")
        self._changed = threading.Condition()

    def count(self, more):
        with self._changed:
            self.open += more
            self._changed.notify_all()

    def is_let_go(self):
        """Whether no driver object is connected any more; one that hung is closed by its own thread."""
        with self._changed:
            return self._changed.wait_for(lambda: self.open == 0, 10.0)

    def make(self):
        self.made += 1
        return ScriptedProjector(self)


class ScriptedProjector:
    """A driver object that does what its lamp says; like many it believes itself connected for good."""

    can_be_dark = True

    def __init__(self, lamp):
        self.lamp, self.rig, self._connected = lamp, lamp.rig, False

    def _do(self, what):
        self.lamp.calls.append(what)
        if what in self.lamp.hangs:
            self.lamp.hanging.set()
            assert self.lamp.go_on.wait(10.0)
        error = self.lamp.once.pop(what, None) or self.lamp.raises.get(what)
        if error is not None:
            raise error
        if what not in ("connect", "close"):
            assert self._connected, f"{what} of a projector that is not connected"

    def connect(self):
        self._do("connect")
        self.lamp.count(not self._connected)
        self._connected = True

    def light(self, brightness):
        self._do("light")
        self.lamp.share = brightness

    def dark(self):
        self._do("dark")
        self.lamp.share = 0.0

    def state(self):
        self._do("state")
        return self.lamp.answer

    def close(self):
        self._do("close")
        self.lamp.count(-self._connected)
        self._connected = False


class PretendedController:
    """Answers on a pseudo-terminal as docs/how-to/light-the-wheel.md says; `answers` overrides by question.

    Use it as a context; `port` is the device for the other side. An answer of None is silence.
    """

    def __init__(self, answers: dict[str, str | None] | None = None) -> None:
        self.answers = answers or {}
        self.level, self.lit, self.heard = 0.0, False, []
        self.on_line: Callable[[str], None] = lambda line: None

    def __enter__(self):
        self._mine, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.port = os.ttyname(self._theirs)
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        return self

    def __exit__(self, *_):
        os.write(self._theirs, b"END\n")
        self._thread.join(10.0)
        assert not self._thread.is_alive()
        self.unplug()

    def unplug(self):
        """Both ends are gone; once."""
        for name in ("_mine", "_theirs"):
            end = self.__dict__.pop(name, None)
            if end is not None:
                os.close(end)

    def _serve(self):
        waiting = b""
        while True:
            waiting += os.read(self._mine, 1000)
            *lines, waiting = waiting.split(b"\n")
            for line in lines:
                text = line.decode()
                if text == "END":
                    return
                self.heard.append(text)
                self.on_line(text)
                answer = self.answers[text] if text in self.answers else self._answer(text)
                if answer is not None:
                    os.write(self._mine, answer.encode())

    def _answer(self, text):
        if text.startswith("LIGHT:LEVEL "):
            self.level = float(text.split()[1])
        elif text.startswith("LIGHT:STATE "):
            self.lit = text.split()[1] == "ON"
        else:
            return {
                "*IDN?": "Example,LP-3,1234,2.1\n",
                "LIGHT:LEVEL?": f"{self.level:.1f}\n",
                "LIGHT:STATE?": f"{int(self.lit)}\n",
                "LIGHT:TEMP?": "41.5\n",
                "LIGHT:HOURS?": "NAN\n",
            }[text]
        return None
