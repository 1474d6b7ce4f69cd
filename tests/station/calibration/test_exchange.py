"""`truewheel calibration export` and `import`: to another program's files and back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sensors.formats import read_calibration, write_calibration
from sensors.simulation.simulated_rig import TRUE_CALIBRATION_UTC, true_calibration
from station.cli import main


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


def calibration_file(tmp_path: Path, preset: str = "standard") -> Path:
    path = tmp_path / "calibration.json"
    calibration = true_calibration("front_left", "left", preset, 3)
    write_calibration(path, calibration, method="simulated", created_utc=TRUE_CALIBRATION_UTC)
    return path


@pytest.mark.parametrize("kind", ["opencv", "kalibr", "mrcal"])
def test_a_calibration_goes_out_and_comes_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    path, foreign, back = calibration_file(tmp_path), tmp_path / "foreign.yaml", tmp_path / "back.json"
    assert run("calibration", "export", path, "--format", kind, "--out", foreign, "--json") == 0
    assert json.loads(capsys.readouterr().out)["cameras"] == 6
    arguments = "--rig", "front_left", "--side", "left", "--out", back, "--json"
    assert run("calibration", "import", foreign, "--format", kind, *arguments) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["heads"] == ["head_1", "head_2", "head_3"]
    assert all(70 < length < 90 for length in said["baselines_mm"].values())
    before, after = read_calibration(path), read_calibration(back)
    assert after.id == said["calibration_id"] != before.id
    for one, other in zip(before.heads, after.heads, strict=True):
        for a, b in zip(one.cameras, other.cameras, strict=True):
            assert np.abs(a.model.parameters - b.model.parameters).max() < 1e-9
            assert np.abs(a.rig_from_camera.translation - b.rig_from_camera.translation).max() < 1e-9

    # Nothing that is there is replaced.
    content = back.read_bytes()
    assert run("calibration", "import", foreign, "--format", kind, *arguments) == 2
    assert run("calibration", "export", path, "--format", kind, "--out", foreign) == 2
    assert back.read_bytes() == content
    assert "Traceback" not in capsys.readouterr().err


def test_an_import_in_a_wrong_unit_is_refused_and_the_cure_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Metres were taken for millimetres: a rig with a baseline of 0.08 mm was written, exit 0."""
    path = calibration_file(tmp_path)
    for kind, unit, seen, right in (("mrcal", "mm", "0.0807 mm", "m"), ("opencv", "m", "e+04 mm", "mm")):
        foreign, back = tmp_path / f"{kind}.yaml", tmp_path / f"{kind}.json"
        assert run("calibration", "export", path, "--format", kind, "--out", foreign) == 0
        arguments = "--format", kind, "--rig", "r", "--side", "right", "--id", "2026-3", "--out", back
        assert run("calibration", "import", foreign, *arguments, "--unit", unit) == 2
        said = capsys.readouterr().err
        assert seen in said
        assert said.endswith(f"say --unit {right}\n")
        assert not back.exists()
        assert run("calibration", "import", foreign, *arguments, "--unit", right) == 0
        imported = read_calibration(back)
        assert (imported.id, imported.rig, imported.side) == ("2026-3", "r", "right")
        assert "head_1 (baseline 80.7" in capsys.readouterr().out


def test_a_model_that_no_other_program_has_ends_with_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.yaml"
    assert (
        run("calibration", "export", calibration_file(tmp_path, "ccir"), "--format", "opencv", "--out", out)
        == 2
    )
    said = capsys.readouterr().err
    assert "field 'head_1.left'" in said
    assert "found model 'division'" in said
    assert not out.exists()
