"""docs/how-to/commission-cameras.md, word for word: from bare cameras to a wheel that is measured right.

Once on simulated cameras, and once on Basler's own code with emulated ones, which look at what the simulated
ones saw: each step's world is put into the folders that the emulation plays.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sensors.drivers.pylon.library import EMULATED_CAMERAS
from sensors.formats import SessionView, read_plate_session, read_shot, write_shot
from sensors.shot import HeadFrames, WheelShot
from station.cli import main
from tests.documents import ROOT, fences
from tests.end_to_end.conftest import Ended, Truewheel
from tests.end_to_end.test_commissioning import Reader
from tests.once import folder_once

PAGE = ROOT / "docs" / "how-to" / "commission-cameras.md"
SAID = "said.json"
EXPOSURE_MS, PLATE_MS = 5.9, 5.0


class Maintainer(Reader):
    """Puts the found exposure into the configuration as well."""

    def _edits(self, text: str) -> None:
        if not text.startswith("[cameras]"):
            super()._edits(text)
            return
        path = Path("configs/station.toml")
        settings = path.read_text()
        for line in text.splitlines()[1:]:
            name = line.split(" = ")[0]
            settings, count = re.subn(rf"^{name} = .*$", line, settings, count=1, flags=re.MULTILINE)
            assert count == 1, name
        path.write_text(settings)


class BaslerMaintainer(Maintainer):
    """Has the page's Basler cameras, emulated, wherever the page has simulated ones."""

    def __init__(self, truewheel: Truewheel, stack: ExitStack, cameras: str) -> None:
        super().__init__(truewheel, stack)
        for number, serial in enumerate(re.findall(r'"(4\d{7})"', cameras)):
            cameras = cameras.replace(serial, f"0815-{number:04d}")
        self._cameras = cameras

    def _edits(self, text: str) -> None:
        if "simulated =" not in text:
            if "[rigs.pylon" not in text:
                super()._edits(text)
            return
        seen = next((what for what in ("plate", "gauge") if f"{what} = {{" in text), "wheel")
        emulation = f'pixel_format = "Mono8"\nemulation = {{ shots = "../world/{seen}" }}'
        cameras = self._cameras.replace('pixel_format = "Mono8"', emulation)
        calibration = re.search("^calibration = .*$", text, re.MULTILINE)
        if calibration is not None:
            cameras = re.sub("^heads = .*$", calibration[0], cameras, flags=re.MULTILINE)
        super()._edits(cameras)


def called(*arguments: object) -> Ended:
    """As the fixture `truewheel`, for what is made once for several tests."""
    out, err, status = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as ended:
            status = int(ended.code or 0)
    return Ended(status, out.getvalue(), err.getvalue())


@folder_once
def followed(folder: Path) -> None:
    """What whoever follows the page with simulated cameras has at its end, and what each command said."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        with ExitStack() as stack:
            reader = Maintainer(called, stack)
            for fence in fences(PAGE):
                reader.does(fence)
    finally:
        os.chdir(before)
    (folder / SAID).write_text(json.dumps(reader.said))


def short(said: dict[str, str]) -> dict[str, str]:
    """What each command said, by its words without options."""
    return {line.removeprefix("truewheel ").split(" --")[0]: out for line, out in said.items()}


@pytest.mark.slow(40)
@pytest.mark.timeout(900)
def test_whoever_follows_the_page_has_a_calibrated_rig_at_its_end() -> None:
    end = followed()
    every = json.loads((end / SAID).read_text())
    said = short(every)
    plate = said.pop("camera exposure front_left")
    wheel = next(out for line, out in every.items() if line.endswith("camera exposure front_left"))
    assert "simulated" in said["camera list"]
    assert re.search(r"^http://127.0.0.1:\d+/ shows front_left", said["camera live front_left"])
    assert len(list((end / "show/front_left").glob("*.png"))) == 6
    # What the page shows as found is what is found.
    assert "exposure_ms = 5.9\n" in wheel
    assert "dark = false" in wheel
    assert re.fullmatch(r"for the plate: --exposure-ms 5\.\d+\n", plate)
    assert said["capture plate-session front_left"].count("  taken; covered: ") == 4
    assert "missing" not in said["capture plate-session front_left"].splitlines()[-1]
    session = json.loads((end / "plate/front_left/session.json").read_text())
    assert [view["stage_mm"] is None for view in session["views"]] == [False, False, False, True]
    assert_calibrated(said)


def assert_calibrated(said: dict[str, str]) -> None:
    assert "accepted:" in said["calibrate plate/front_left"]
    assert "wrote placed/front_left.json" in said["calibration frame gauge"]
    angles = re.search(r"^camber (\S+)° .*\ntoe +(\S+)° ", said["measure shots/front_left/001"])
    assert angles is not None, said
    assert float(angles[1]) == pytest.approx(-0.5, abs=0.003)
    assert float(angles[2]) == pytest.approx(0.1, abs=0.003)


def first_check(reader: Reader) -> str:
    return next(out for line, out in reader.said.items() if line.endswith("--uncalibrated"))


def timeless(said: str) -> str:
    """Without when it was, and how long it took: the hashes of calibrations stay."""
    return re.sub(r"\d{8}T\d{6}|[\d.]+ m?s$", "…", said, flags=re.MULTILINE)


def put_world(end: Path, world: Path) -> None:
    """What the cameras of the followed page saw, as the shots that emulated ones are to see, step by step."""
    wheel = read_shot(end / "shots/front_left/001")
    plain = [HeadFrames(h.name, *(replace(f, in_force=None) for f in (h.left, h.right))) for h in wheel.heads]
    wheel = replace(wheel, heads=tuple(plain))
    write_shot(world / "wheel" / "1", wheel)
    rng = np.random.default_rng(5)
    for number, view in enumerate(read_plate_session(end / "plate/front_left").views):
        still = seen_as(wheel, view)
        # The plate stands still for two shots, of which the second is taken; each has noise of its own.
        write_shot(world / "plate" / f"{number}a", noisy(still, rng))
        write_shot(world / "plate" / f"{number}b", still)
    [gauge] = read_plate_session(end / "gauge/front_left").views
    write_shot(world / "gauge" / "1", seen_as(wheel, gauge))


def seen_as(shot: WheelShot, view: SessionView) -> WheelShot:
    """The shot with a view's images in place of its own."""
    heads = [
        HeadFrames(
            head.name,
            replace(head.left, image=view.images[head.name, "left"], exposure_ms=PLATE_MS),
            replace(head.right, image=view.images[head.name, "right"], exposure_ms=PLATE_MS),
        )
        for head in shot.heads
    ]
    return replace(shot, heads=tuple(heads))


def noisy(shot: WheelShot, rng: np.random.Generator) -> WheelShot:
    """The shot a moment before."""

    def before(frame):  # type: ignore[no-untyped-def]
        image = frame.image + rng.normal(0.0, 1.0, frame.image.shape)
        return replace(frame, image=image.round().clip(0, 255).astype(np.uint8))

    heads = [HeadFrames(head.name, before(head.left), before(head.right)) for head in shot.heads]
    return replace(shot, heads=tuple(heads))


@pytest.mark.slow(40)
@pytest.mark.timeout(900)
def test_whoever_follows_the_page_with_basler_s_own_code_has_the_same_rig_at_its_end(
    truewheel: Truewheel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From six bare cameras, emulated by their maker, to a calibrated rig by the page alone."""
    pytest.importorskip("pypylon.pylon", reason="pypylon is not installed: pip install 'truewheel[pylon]'")
    end = followed()
    put_world(end, tmp_path / "world")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(EMULATED_CAMERAS, "6")
    shown = fences(PAGE)
    [cameras] = [fence.text for fence in shown if "[rigs.pylon" in fence.text]
    with ExitStack() as stack:
        reader = BaslerMaintainer(truewheel, stack, cameras)
        for fence in shown:
            reader.does(fence)
    said = short(reader.said)
    assert "0815-0005" in said["camera list"]
    assert "not calibrated yet, the station does not start with them: front_left" in first_check(reader)
    assert len(list(Path("show/front_left").glob("*.png"))) == 6
    assert said["capture plate-session front_left"].count("  taken; covered: ") == 4
    assert_calibrated(said)
    told = short(json.loads((end / SAID).read_text()))
    for command in ("calibrate plate/front_left", "measure shots/front_left/001"):
        assert timeless(said[command]) == timeless(told[command])
    settings = read_shot("shots/front_left/001").frames[5].in_force
    assert settings is not None
    assert (settings.serial_number, settings.exposure_ms) == ("0815-0005", EXPOSURE_MS)
