"""`truewheel gauge` from files: figures, exit status, one object on standard output, pictures."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.cli import main


def gauge(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    status = 0
    try:
        main(["gauge", *map(str, arguments)])
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 0
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def figures(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, dict[str, Any]]:
    status, out, _ = gauge(capsys, *arguments, "--json")
    return status, json.loads(out)


@pytest.mark.parametrize(("method", "percent", "ndc"), [("anova", 27.9, 4), ("range", 26.7, 5)])
def test_grr_of_the_published_example(
    capsys: pytest.CaptureFixture[str], published_data: Path, method: str, percent: float, ndc: int
) -> None:
    file = published_data / "aiag_msa4" / "grr_10x3x3.csv"
    status, found = figures(capsys, "grr", "--from-file", file, "--method", method)
    assert status == 0
    assert round(found["figures"]["grr_percent_study_variation"], 1) == percent
    assert found["figures"]["ndc"] == ndc
    assert {"repeatability", "reproducibility"} <= set(found["figures"])
    assert (found["parts"], found["appraisers"], found["trials"], found["type"]) == (10, 3, 3, 2)
    status, found = figures(
        capsys, "grr", "--from-file", file, "--method", method, "--ignore-appraiser", "--tolerance", "4"
    )
    assert (found["type"], found["figures"]["reproducibility"]) == (3, 0.0)
    assert found["figures"]["grr_percent_tolerance"] == pytest.approx(600 * found["figures"]["grr"] / 4)
    assert status == 1


def test_bad_gauge_ends_with_status_1_and_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(1)
    lines = [f"{part},{trial},{rng.normal():.4f}" for part in range(10) for trial in range(1, 4)]
    (tmp_path / "noise.csv").write_text("part,trial,value\n" + "\n".join(lines))
    status, out, _ = gauge(capsys, "grr", "--from-file", tmp_path / "noise.csv")
    assert status == 1
    assert "NOT acceptable" in out
    assert "MISSED" in out


def test_study_leaves_table_pictures_and_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    values = 5.0 + 0.01 * np.sin(np.arange(50.0))
    (tmp_path / "v.csv").write_text("value\n" + "\n".join(f"{value:.6f}" for value in values))
    status, found = figures(
        capsys, "type1", "--from-file", tmp_path / "v.csv", "--reference", "5", "--tolerance", "1",
        "--unit", "°", "--out", tmp_path / "out",
    )  # fmt: skip
    assert status == 0
    assert found["figures"]["cg"] == pytest.approx(0.2 / (6 * np.std(values, ddof=1)), rel=1e-4)
    assert sorted(Path(file).name for file in found["files"]) == [
        "gauge-type1.csv", "gauge-type1.md", "gauge-type1.png",
    ]  # fmt: skip
    assert all(Path(file).stat().st_size > 100 for file in found["files"])


def test_type1_of_equal_values_has_null_figures_and_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "v.csv").write_text("value\n" + "5\n" * 25)
    status, found = figures(
        capsys, "type1", "--from-file", tmp_path / "v.csv", "--reference", "5", "--tolerance", "1"
    )
    assert (status, found["figures"]["cg"], found["figures"]["cgk"]) == (1, None, None)
    assert "resolution" in found["assessment"]


def test_linearity_and_stability(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(2)
    lines = [f"{r},{r + 0.05 * r + rng.normal(0, 0.01):.5f}" for r in (1, 2, 3, 4, 5) for _ in range(12)]
    (tmp_path / "l.csv").write_text("reference,value\n" + "\n".join(lines))
    status, found = figures(capsys, "linearity", "--from-file", tmp_path / "l.csv", "--out", tmp_path)
    assert (status, found["masters"]) == (1, 5)
    assert found["figures"]["slope"] == pytest.approx(0.05, abs=0.005)

    lines = [f"2026-01-{day:02d},{rng.normal(0, 0.01) + 0.01 * day:.5f}" for day in range(1, 29)]
    (tmp_path / "s.csv").write_text("time,value\n" + "\n".join(reversed(lines)))
    status, found = figures(
        capsys, "stability", "--from-file", tmp_path / "s.csv", "--rules", "nelson", "--out", tmp_path
    )
    assert status == 1
    assert found["figures"]["drift_per_day"] == pytest.approx(0.01, rel=0.2)
    assert found["figures"]["signals_location"] > 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["grr"], "--from-file, --study"),
        (["grr", "--study", "x"], "--database"),
        (["type1", "--from-file", "{csv}"], "--reference"),
        (["type1", "--from-file", "{csv}", "--reference", "1"], "--tolerance"),
        (["grr", "--from-file", "{csv}", "--method", "guess"], "guess"),
        (["grr", "--from-file", "/nowhere/x.csv"], "/nowhere/x.csv"),
        (["grr", "--from-file", "{csv}", "--database", "sqlite:///x.db"], "--name"),
        (["stability", "--from-file", "{csv}"], "one master"),
        (["linearity", "--from-file", "{csv}"], "reference"),
        (["grr", "--from-file", "{csv}", "--tolerance", "inf"], "--tolerance"),
        (["grr", "--from-file", "{csv}", "--multiplier", "nan"], "--multiplier"),
        (["type1", "--from-file", "{csv}", "--reference", "nan", "--tolerance", "1"], "--reference"),
        (["budget", "--tolerance", "nan", "--resolution", "1"], "--tolerance"),
    ],
)
def test_wrong_use_ends_with_status_2_and_no_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    csv = tmp_path / "v.csv"
    csv.write_text("part,value\n" + "".join(f"{n % 2},{n}\n" for n in range(20)))
    status, out, err = gauge(capsys, *(text.format(csv=csv) for text in arguments), "--json")
    assert (status, out) == (2, "")
    assert said in err
    assert "Traceback" not in err


def test_budget_of_gauge_studies(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(5)
    values = 5.002 + rng.normal(0, 0.001, 50)
    (tmp_path / "t1.csv").write_text("value\n" + "\n".join(f"{value:.6f}" for value in values))
    lines = [
        f"{part},{who},{trial},{part + 0.01 * (who == 'B') + rng.normal(0, 0.002):.5f}"
        for part in range(10) for who in "AB" for trial in (1, 2)
    ]  # fmt: skip
    (tmp_path / "grr.csv").write_text("part,appraiser,trial,value\n" + "\n".join(lines))
    status, found = figures(
        capsys, "budget", "--tolerance", "0.5", "--type1-file", tmp_path / "t1.csv", "--reference", "5",
        "--grr-file", tmp_path / "grr.csv", "--resolution", "0.001", "--calibration-u", "0.0005",
    )  # fmt: skip
    assert status == 0
    system = math.sqrt(np.std(values, ddof=1) ** 2 + 0.0005**2 + (values.mean() - 5) ** 2 / 3)
    assert found["figures"]["u_ms"] == pytest.approx(system, rel=1e-3)
    # Two appraisers 0.01 apart: 0.01 / √2.
    assert found["figures"]["u_mp"] == pytest.approx(math.hypot(system, 0.01 / math.sqrt(2)), rel=0.1)
    status, out, err = gauge(capsys, "budget", "--tolerance", "0.5")
    assert (status, out) == (2, "")
    assert "at least one contribution" in err


def test_budget_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "b.csv").write_text(
        "contribution,u,source\nCAL,0.001,certificate\nEVR,0.002,type 1\nEVO,0.004,GRR\nT,0.003,10 K\n"
    )
    status, found = figures(
        capsys, "budget", "--from-file", tmp_path / "b.csv", "--tolerance", "0.2", "--out", tmp_path / "out"
    )
    assert status == 0
    assert found["figures"]["q_ms"] == pytest.approx(100 * 4 * math.sqrt(5) * 1e-3 / 0.2)
    assert found["figures"]["q_mp"] == pytest.approx(100 * 4 * math.sqrt(26) * 1e-3 / 0.2)
    status, out, err = gauge(capsys, "budget", "--from-file", tmp_path / "b.csv", "--tolerance", "0.02")
    assert status == 1
    (tmp_path / "b.csv").write_text("contribution,u\nCAL,0.001\nXYZ,0.002\n")
    status, out, err = gauge(capsys, "budget", "--from-file", tmp_path / "b.csv", "--tolerance", "0.2")
    assert (status, out) == (2, "")
    assert "line 3, column contribution" in err


def test_zero_outside_the_band_between_the_masters_misses_the_goal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [f"{ref},{ref + error:.3f}" for ref in (0, 10) for error in 3 * (0.037, -0.003)]
    (tmp_path / "masters.csv").write_text("reference,value\n" + "\n".join(lines))
    status, found = figures(capsys, "linearity", "--from-file", tmp_path / "masters.csv", "--unit", "mm")
    assert status == 1
    assert found["figures"]["zero_outside_band"] == 1.0
    assert found["figures"]["masters_outside_band"] == 0
    assert "between the masters, at 5 mm" in found["assessment"]


def test_trials_that_are_all_alike_show_the_interaction_and_no_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cells = [("1", "1.2"), ("2", "2"), ("3", "2.7"), ("4", "4.1"), ("5", "5.3")]
    lines = [
        f"{part},{name},{trial},{value}"
        for part, pair in enumerate(cells, start=1)
        for name, value in zip("AB", pair, strict=True)
        for trial in (1, 2)
    ]
    (tmp_path / "alike.csv").write_text("part,appraiser,trial,value\n" + "\n".join(lines))
    status, found = figures(capsys, "grr", "--from-file", tmp_path / "alike.csv")
    assert status == 1
    assert found["figures"]["repeatability"] == 0.0
    assert found["figures"]["grr"] == pytest.approx(0.1628, abs=5e-5)
    assert found["figures"]["grr_percent_study_variation"] == pytest.approx(10.09, abs=5e-3)
    assert found["figures"]["ndc"] == 13
    assert found["verdict"] == "no verdict"


def test_the_pooling_level_is_a_choice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(9)
    cells = rng.normal(0.0, 1.0, 5)[:, None] + rng.normal(0.0, 0.12, (5, 2))
    lines = [
        f"{part},{name},{trial},{cells[part, who] + rng.normal(0.0, 0.1):.4f}"
        for part in range(5)
        for who, name in enumerate("AB")
        for trial in (1, 2)
    ]
    (tmp_path / "study.csv").write_text("part,appraiser,trial,value\n" + "\n".join(lines))
    kept = figures(capsys, "grr", "--from-file", tmp_path / "study.csv")[1]
    p = kept["interaction_p"]
    assert 0.05 < p < 0.25
    assert not kept["interaction_pooled"]
    pooled = figures(capsys, "grr", "--from-file", tmp_path / "study.csv", "--pooling-p", "0.05")[1]
    assert pooled["interaction_pooled"]
    assert pooled["pooling_p"] == 0.05
    assert pooled["figures"]["repeatability"] > kept["figures"]["repeatability"]
