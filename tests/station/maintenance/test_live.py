"""The live page: served on this computer alone, bounded, and never older than it looks."""

from __future__ import annotations

import json
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator

import numpy as np
import pytest

from alignment.errors import CameraTimeoutError, ConfigurationError
from station.maintenance.live import LiveView, served, watch_cameras
from tests.sensors.samples import shot as sample_shot


def refused(address: str, host: str | None = None) -> bool:
    """Whether there is nothing to be had."""
    try:
        fetched(address, host)
    except urllib.error.HTTPError as error:
        error.close()
        return error.code == 404
    return False


def fetched(address: str, host: str | None = None) -> tuple[str, bytes]:
    request = urllib.request.Request(address, headers={} if host is None else {"Host": host})
    with urllib.request.urlopen(request, timeout=10.0) as answer:
        return answer.headers["Content-Type"], answer.read()


@pytest.fixture
def view() -> LiveView:
    return LiveView("front_left", ("front_left/head_1/left", "front_left/head_1/right"))


@pytest.fixture
def address(view: LiveView) -> Iterator[str]:
    with served(view) as where:
        yield where


def test_the_page_shows_what_was_taken_last(view: LiveView, address: str) -> None:
    kind, text = fetched(address)
    assert kind.startswith("text/html")
    assert b"front_left/head_1/right" in text
    assert b"http://" not in text
    assert b"https://" not in text
    shot = sample_shot(rig="front_left")
    view.show(shot)
    state = json.loads(fetched(address + "state.json")[1])
    assert (state["number"], state["problem"], len(state["cameras"])) == (1, "", len(shot.frames))
    kind, picture = fetched(address + "picture/1.jpg?1")
    assert (kind, picture[:2]) == ("image/jpeg", b"\xff\xd8")


def test_pictures_from_before_a_failure_are_not_shown_on(view: LiveView, address: str) -> None:
    view.show(sample_shot(rig="front_left"))
    view.fail("camera front_left/head_1/left: is gone")
    state = json.loads(fetched(address + "state.json")[1])
    assert (state["number"], state["problem"]) == (2, "camera front_left/head_1/left: is gone")
    assert refused(address + "picture/0.jpg")


@pytest.mark.parametrize("path", ["picture/99.jpg", "picture/-1.jpg", "picture/x.jpg", "configs"])
def test_nothing_else_is_served(address: str, path: str) -> None:
    assert refused(address + path)


def test_a_page_of_another_name_that_leads_here_gets_nothing(address: str) -> None:
    assert refused(address + "state.json", host="evil.example:80")


def test_a_port_that_is_taken_is_told(address: str, view: LiveView) -> None:
    port = int(address.rstrip("/").rpartition(":")[2])
    with pytest.raises(ConfigurationError, match="a port that is free"), served(view, port):
        pass


class Flaky:
    """A rig whose second shot fails."""

    def __init__(self) -> None:
        self.log: list[str] = []

    def arm(self) -> None:
        self.log.append("arm")

    def shoot(self) -> object:
        self.log.append("shoot")
        if self.log.count("shoot") == 2:
            raise CameraTimeoutError("front_left/head_1/left", "no frame")
        return sample_shot(rig="front_left")


def test_a_shot_that_fails_is_shown_and_the_view_goes_on(view: LiveView) -> None:
    rig, now, ended, shown = Flaky(), iter(np.arange(0.0, 100.0)), threading.Event(), []
    ended.wait = lambda timeout: shown.append(json.loads(view.answer("/state.json")[1])["problem"])  # type: ignore[method-assign, assignment, func-returns-value, index]
    taken = watch_cameras(rig, view, 6.5, clock=lambda: float(next(now)), ended=ended)  # type: ignore[arg-type]
    assert taken == 2
    assert rig.log == ["arm", "shoot", "shoot", "arm", "shoot"]
    assert shown == ["", "camera front_left/head_1/left: no frame", ""]
