"""What a quality engineer is told where nothing was seen: the reason and the cure, never "acceptable"."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest

from db.connection import migrate
from db.records import VehicleRecord, Verdict
from db.store import ResultStore
from tests.db.example_records import CALIBRATION, NOON, cycle, wheel

Run = Callable[..., tuple[int, str, str]]


def study(tmp_path: Path, name: str, lines: Sequence[str]) -> Path:
    file = tmp_path / name
    file.write_text("\n".join(lines) + "\n")
    return file


def crossed(value: Callable[[int, str, int], float]) -> list[str]:
    return ["part,appraiser,trial,value"] + [
        f"{part},{who},{trial},{value(part, who, trial):.4f}"
        for part in range(1, 4) for who in "AB" for trial in (1, 2)
    ]  # fmt: skip


def days(values: Sequence[float]) -> list[str]:
    return ["time,value"] + [f"2026-11-{day:02d}T08:00:00,{value}" for day, value in enumerate(values, 1)]


STUCK: dict[str, tuple[list[str], list[str]]] = {
    "grr": (crossed(lambda *_: 0.0), ["--tolerance", "1"]),
    "grr by range": (crossed(lambda *_: 299.85), ["--method", "range", "--tolerance", "1"]),
    "grr without appraiser": (crossed(lambda *_: 0.1), ["--ignore-appraiser"]),
    "grr of copied repetitions": (crossed(lambda part, *_: float(part)), ["--tolerance", "1"]),
    "grr of copied repetitions by range": (crossed(lambda part, *_: float(part)), ["--method", "range"]),
    "stability": (days([0.1] * 25), []),
    "stability against a certified value": (days([0.1] * 25), ["--reference", "0.03"]),
    "stability by deviation": (days([0.1] * 24), ["--size", "3", "--chart", "xbar-s"]),
    "stability of subgroups that stand still": (days([0.1, 0.1, 0.2, 0.2] * 6), ["--size", "2"]),
    "stability of three": (days([0.1, 0.11, 0.1]), []),
    "stability of seven": (days([0.1, 0.11, 0.1, 0.12, 0.11, 0.1, 0.11]), []),
    "type1": (["value"] + ["0.1"] * 25, ["--reference", "0.03", "--tolerance", "1"]),
    "linearity": (
        ["reference,value"] + [f"{r},{r}" for r in (0.1, 0.3, 0.7) for _ in range(4)], [],
    ),
    "linearity of a dead gauge": (
        ["reference,value"] + [f"{r},0.3" for r in (0.1, 0.3, 0.7) for _ in range(4)], [],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", STUCK)
def test_study_without_spread_has_no_verdict_and_ends_with_status_1(
    tmp_path: Path, run: Run, name: str
) -> None:
    """A dead gauge was "0.0 %: acceptable" and "Stable: no signal", both with exit status 0."""
    lines, options = STUCK[name]
    command = ("gauge", name.partition(" ")[0], "--from-file", study(tmp_path, "s.csv", lines), *options)
    status, out, err = run(*command, "--json")
    found = json.loads(out)
    assert (status, err, found["verdict"]) == (1, "", "no verdict")
    limited = {goal["figure"]: goal for goal in found["goals"]}
    assert limited
    assert all((goal["value"], goal["met"]) == (None, False) for goal in limited.values())
    said = found["assessment"]
    assert not any(word in said for word in ("acceptable", "table:", "is linear", ": capable"))
    # Why, and what to do.
    assert any(word in said for word in ("resolution", "points"))
    assert "record more digits" in said or "are needed" in said
    status, out, _ = run(*command, "--out", tmp_path / "out")
    assert status == 1
    assert "no verdict" in out
    assert "MISSED" not in out
    assert "nan" not in (tmp_path / "out" / f"gauge-{name.partition(' ')[0]}.md").read_text()


def test_equal_values_say_so_in_every_study(tmp_path: Path, run: Run) -> None:
    for name in ("grr", "stability", "type1"):
        lines, options = STUCK[name]
        _, out, _ = run("gauge", name, "--from-file", study(tmp_path, "s.csv", lines), *options)
        said = " ".join(out.split())
        assert "All values are equal: the resolution is too coarse to judge the spread" in said


@pytest.mark.parametrize("field", ["grr_const.csv", "stab_const.csv"])
def test_study_seen_in_the_field_has_no_verdict(published_data: Path, run: Run, field: str) -> None:
    file = published_data / "field_inputs" / "study-without-spread" / field
    kind = "grr" if field.startswith("grr") else "stability"
    for options in ([], ["--method", "range"]) if kind == "grr" else ([],):
        status, out, _ = run("gauge", kind, "--from-file", file, *options, "--json")
        assert (status, json.loads(out)["verdict"]) == (1, "no verdict")


def test_verdicts_of_gauges_that_were_seen_stay(tmp_path: Path, run: Run) -> None:
    good = study(
        tmp_path, "g.csv", crossed(lambda part, who, trial: part + 0.001 * trial * (part + (who == "A")))
    )
    status, out, _ = run("gauge", "grr", "--from-file", good, "--json")
    found = json.loads(out)
    assert (status, found["verdict"]) == (0, "shown")
    assert ": acceptable; 3 parts, 10 are usual" in found["assessment"]
    noise = study(
        tmp_path, "n.csv", crossed(lambda part, who, trial: (7 * part + 5 * trial + (who == "A")) % 3)
    )
    status, out, _ = run("gauge", "grr", "--from-file", noise, "--json")
    assert (status, json.loads(out)["verdict"]) == (1, "not shown")
    assert "the parts differ by no more than the repetitions" in json.loads(out)["assessment"]
    wave = study(tmp_path, "w.csv", days([0.1 + 0.01 * math.sin(day * day) for day in range(10)]))
    status, out, _ = run("gauge", "stability", "--from-file", wave, "--json")
    assert (status, json.loads(out)["verdict"]) == (0, "shown")
    assert json.loads(out)["assessment"].startswith("Stable: no signal; 10 points, 20 are usual")


def test_coarse_resolution_is_said_and_spoils_the_sentence_too(tmp_path: Path, run: Run) -> None:
    """With a resolution of 20 % of the tolerance the sentence said "capable", and the status 1."""
    values = study(tmp_path, "v.csv", ["value"] + [f"{5 + 0.001 * (n % 7 - 3)}" for n in range(50)])
    options = ("--reference", "5", "--tolerance", "1", "--json")
    status, out, _ = run("gauge", "type1", "--from-file", values, *options, "--resolution", "0.05")
    assert (status, json.loads(out)["assessment"].split("; ")[0].endswith(": capable")) == (0, True)
    status, out, _ = run("gauge", "type1", "--from-file", values, *options, "--resolution", "0.0501")
    said = json.loads(out)["assessment"]
    assert status == 1
    assert "NOT capable" in said
    assert "the resolution is 5.0 % of the tolerance" in said
    steps = study(tmp_path, "c.csv", ["value"] + [f"{5 + 0.01 * (n % 9 == 0)}" for n in range(50)])
    status, out, _ = run("gauge", "type1", "--from-file", steps, *options)
    assert "values differ by 0.01 at least, more than their spread" in json.loads(out)["assessment"]


def test_budget_of_equal_readings_is_no_budget(tmp_path: Path, run: Run) -> None:
    stuck = study(tmp_path, "t.csv", ["value"] + ["5.1"] * 25)
    command = ("gauge", "budget", "--tolerance", "0.5", "--type1-file", stuck, "--json")
    status, out, _ = run(*command)
    assert (status, json.loads(out)["verdict"], json.loads(out)["figures"]["q_ms"]) == (1, "no verdict", None)
    assert json.loads(out)["figures"]["least_tolerance_ms"] is None
    status, out, _ = run(*command, "--resolution", "0.001")
    assert (status, json.loads(out)["verdict"]) == (0, "shown")
    nothing = study(tmp_path, "b.csv", ["contribution,u", "CAL,0", "T,0"])
    status, out, _ = run("gauge", "budget", "--tolerance", "0.5", "--from-file", nothing, "--json")
    assert (status, json.loads(out)["verdict"]) == (1, "no verdict")
    two = study(tmp_path, "two.csv", ["value", "5.1", "5.2"])
    status, out, err = run("gauge", "budget", "--tolerance", "0.5", "--type1-file", two, "--json")
    assert (status, out) == (2, "")
    assert "at least 10 repetitions" in err


def database(tmp_path: Path, toes_deg: Sequence[float], hours: float) -> str:
    url = f"sqlite:///{tmp_path / 'r.db'}"
    migrate(url)
    with ResultStore(url) as store:
        store.record_calibration(CALIBRATION)
        for number, toe in enumerate(toes_deg):
            time = NOON + timedelta(hours=hours * number)
            measured = wheel(
                "front_left", toe=math.radians(toe), toe_low=0.0, toe_high=math.radians(0.2),
                verdict=Verdict.OK, measured_utc=time,
            )  # fmt: skip
            store.write_cycle(
                cycle(
                    UUID(int=number + 1), received_utc=time, measured_utc=time, wheels=(measured,), axles=(),
                    vehicle=VehicleRecord(f"W{number:016d}", "compact"), vehicle_angles=None,
                )
            )  # fmt: skip
    return url


def capability_of(run: Run, url: str, *options: str) -> tuple[dict[str, Any], dict[str, Any]]:
    status, out, err = run(
        "report", "capability", "--database", url, "--characteristic", "front_left.toe", "--json", *options
    )
    assert (status, err) == (0, "")
    report = json.loads(out)
    return report["figures"], report["sections"][0]["rows"][0]


@pytest.mark.parametrize("hours", [0.001, 1.5])
def test_two_values_are_not_counted_as_capable(tmp_path: Path, run: Run, hours: float) -> None:
    """Cpk 2.12 with a lower limit of -0.85 was "capable_characteristics 1 of 1"."""
    figures, row = capability_of(run, database(tmp_path, (0.10, 0.12), hours))
    assert (figures["capable_characteristics"], figures["judged_characteristics"]) == (0, 1)
    assert figures["characteristics_without_verdict"] == 1
    assert figures["cpk"] == pytest.approx(2.12, abs=0.01)
    assert figures["cpk_low"] < 0
    assert row["verdict"] == "no verdict"
    assert "2 values" in row["verdict_reason"]


@pytest.mark.parametrize(("n", "hours"), [(2, 1.5), (12, 0.1), (40, 0.4)])
def test_process_that_stands_still_has_no_verdict_and_no_normality(
    tmp_path: Path, run: Run, n: int, hours: float
) -> None:
    figures, row = capability_of(run, database(tmp_path, [0.1] * n, hours))
    assert (figures["capable_characteristics"], figures["characteristics_without_verdict"]) == (0, 1)
    assert [row[name] for name in ("cp", "cpk", "pp", "ppk", "normality_p", "expected_outside_ppm")] == [
        None
    ] * 6
    assert (row["sigma_deg"], row["verdict"]) == (0.0, "no verdict")
    assert "record more digits" in row["verdict_reason"]


@pytest.mark.parametrize(("spread", "verdict"), [(0.012, "shown"), (0.03, "not shown"), (0.05, "not shown")])
def test_capability_is_shown_by_its_lower_limit(
    tmp_path: Path, run: Run, spread: float, verdict: str
) -> None:
    """The middle one has a Cpk above 1.33 whose lower limit is not."""
    toes = [0.1 + spread * math.sin(1.7 * number + number * number) for number in range(48)]
    figures, row = capability_of(run, database(tmp_path, toes, 0.2))
    assert (row["cpk_low"] > 1.33) == (verdict == "shown")
    assert (row["cpk"] > 1.33) == (spread < 0.05)
    assert (row["verdict"], figures["capable_characteristics"]) == (verdict, int(verdict == "shown"))


def test_chart_of_values_that_stand_still_has_no_count_of_signals(tmp_path: Path, run: Run) -> None:
    url = database(tmp_path, [0.1] * 30, 1.5)
    status, out, _ = run("report", "chart", "--database", url, "--characteristic", "front_left.toe", "--json")
    report = json.loads(out)
    row = report["sections"][0]["rows"][0]
    assert (status, row["signals"], row["spread_signals"]) == (0, None, None)
    assert report["figures"]["charts_without_spread"] == 1


def test_differences_without_spread_have_no_confidence_limits(tmp_path: Path, run: Run) -> None:
    """An interval of no width, and a change of which nothing is known, were printed as certain."""
    url = database(tmp_path, [0.1] * 30, 1.5)
    _, out, _ = run("report", "drift", "--database", url, "--characteristic", "front_left.toe", "--json")
    (row,) = json.loads(out)["sections"][0]["rows"]
    assert (row["change"], row["low"], row["high"], row["p"]) == (0.0, None, None, None)
