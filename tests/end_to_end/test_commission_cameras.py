"""docs/how-to/commission-cameras.md, word for word: from bare cameras to a wheel that is measured right."""

from __future__ import annotations

import json
import re
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.documents import ROOT, fences
from tests.end_to_end.conftest import Truewheel
from tests.end_to_end.test_commissioning import Reader

PAGE = ROOT / "docs" / "how-to" / "commission-cameras.md"


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


@pytest.mark.slow(35)
@pytest.mark.timeout(900)
def test_whoever_follows_the_page_has_a_calibrated_rig_at_its_end(
    truewheel: Truewheel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with ExitStack() as stack:
        reader = Maintainer(truewheel, stack)
        for fence in fences(PAGE):
            reader.does(fence)
        said = {line.removeprefix("truewheel ").split(" --")[0]: out for line, out in reader.said.items()}
        plate = said.pop("camera exposure front_left")
        wheel = next(out for line, out in reader.said.items() if line.endswith("camera exposure front_left"))
    assert "simulated" in said["camera list"]
    assert re.search(r"^http://127.0.0.1:\d+/ shows front_left", said["camera live front_left"])
    assert len(list(Path("show/front_left").glob("*.png"))) == 6
    # What the page shows as found is what is found.
    assert "exposure_ms = 5.9\n" in wheel
    assert "dark = false" in wheel
    assert re.fullmatch(r"for the plate: --exposure-ms 5\.\d+\n", plate)
    assert said["capture plate-session front_left"].count("  taken; covered: ") == 4
    assert "missing" not in said["capture plate-session front_left"].splitlines()[-1]
    session = json.loads(Path("plate/front_left/session.json").read_text())
    assert [view["stage_mm"] is None for view in session["views"]] == [False, False, False, True]
    assert "accepted:" in said["calibrate plate/front_left"]
    assert "wrote placed/front_left.json" in said["calibration frame gauge"]
    angles = re.search(r"^camber (\S+)° .*\ntoe +(\S+)° ", said["measure shots/front_left/001"])
    assert angles is not None, said
    assert float(angles[1]) == pytest.approx(-0.5, abs=0.003)
    assert float(angles[2]) == pytest.approx(0.1, abs=0.003)
