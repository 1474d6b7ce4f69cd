"""A sweep of the steering through the command line, as its page shows it, and what is refused of it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from sensors.formats import read_steering_truth
from station.cli import main
from tests.documents import snippets

PAGE = "docs/how-to/measure-the-steering-axis.md"


def ran(arguments: list[str], capsys: pytest.CaptureFixture[str], status: int) -> str:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    told = capsys.readouterr()
    assert end.value.code == status, told
    return told.out if status != 2 else told.err


@pytest.mark.slow(18)
def test_the_page_s_sweep_finds_the_axes_of_both_front_wheels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    # Smaller images than the page's: a third of the time.
    Path("light.toml").write_text('rig = "ccir"\n', encoding="utf-8")
    [commands] = snippets(PAGE, "sh")
    simulate, measure = (line.split()[1:] for line in commands.splitlines())
    ran([*simulate, "--config", "light.toml"], capsys, 0)
    result: dict[str, Any] = json.loads(ran(measure, capsys, 0))
    truth = read_steering_truth("out/sweep/steering_truth.json").wheels
    assert result["reference"] == "thrust line"
    for name in ("front_left", "front_right"):
        wheel, true = result["wheels"][name], truth[name]  # type: ignore[index]
        assert abs(wheel["caster_deg"] - true.caster_deg) < 0.3 / 60.0
        assert abs(wheel["kpi_deg"] - true.kpi_deg) < 5.0 / 60.0
        assert abs(wheel["scrub_mm"] - true.scrub_mm) < 1.0
        assert abs(wheel["trail_mm"] - true.trail_mm) < 0.5
        assert wheel["positions"] == 9
        assert 0.0 < wheel["caster_u95_deg"] < wheel["kpi_u95_deg"]
        assert wheel["steered_left_deg"] == pytest.approx(true.angles_deg[-1], abs=0.01)
    assert 0.3 < result["toe_out_left_turn_deg"] < 1.0
    # Of three positions alone there is none; one reason, and what is known is null.
    for rig in ("front_left", "front_right"):
        for number in range(4, 10):
            shutil.rmtree(Path("out/sweep", rig, f"pos_{number:02d}"))
    refused = json.loads(ran(measure, capsys, 1))
    assert refused["outcome"] == "refused"
    assert refused["wheels"]["front_left"]["code"] == "sweep_too_small"
    assert refused["wheels"]["front_left"]["caster_deg"] is None
    assert refused["toe_out_left_turn_deg"] is None
    shutil.rmtree(Path("out/sweep/front_left/pos_01"))
    assert "as many positions" in ran(measure, capsys, 2)
