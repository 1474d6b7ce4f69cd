from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from alignment.calibration.gate import CalibrationProblem, GateJudgement, camera_figures, judge_calibration
from station.calibration.report import write_calibration_report
from tests.station.calibrations import adjusted

NOON = datetime(2026, 11, 22, 12, tzinfo=UTC)


def test_report_is_one_file_that_names_every_camera_view_and_figure(tmp_path: Path) -> None:
    adjustment, calibration = adjusted()
    path = write_calibration_report(
        tmp_path / "new" / "report",
        adjustment,
        judge_calibration(adjustment, calibration),
        identity=calibration.id,
        rig="front_left",
        side="left",
        method="joint adjustment",
        created_utc=NOON,
    )
    page = path.read_text(encoding="utf-8")
    assert [entry.name for entry in path.parent.iterdir()] == ["report.html"]
    assert page.count('src="data:image/png;base64,') == 5
    assert "http:" not in page
    assert "https:" not in page
    for head, side in adjustment.data.cameras:
        assert f"<td>{head} {side}</td>" in page
    for view in adjustment.data.views:
        assert f"<td>{view.name}</td>" in page
    assert "2026-11-22 12:00:00 UTC" in page


def test_markup_in_what_somebody_typed_stays_text(tmp_path: Path) -> None:
    """The name of the rig, of a view, of a head; the identity, the method, the reason."""
    adjustment, _ = adjusted()
    nasty = "</style><script>alert(1)</script>\"'&amp;"
    data = adjustment.data
    views = [replace(view, name=nasty) for view in data.views]
    redundancy = {(nasty, "left"): 1.0}
    adjustment = replace(adjustment, data=replace(data, views=views), redundancy=redundancy)
    figures = tuple(replace(each, camera=(nasty, "left")) for each in camera_figures(adjustment))
    path = write_calibration_report(
        tmp_path,
        adjustment,
        GateJudgement(CalibrationProblem.NOISY, nasty, figures),
        identity=nasty,
        rig=nasty,
        side="left",
        method=nasty,
        created_utc=NOON,
    )
    page = path.read_text(encoding="utf-8")
    assert "<script" not in page
    assert page.count("</style>") == 1
    assert page.count("&lt;script&gt;alert(1)") >= 5 + len(views) + len(figures)


def test_report_of_a_refused_calibration_says_why_and_escapes_names(tmp_path: Path) -> None:
    adjustment, _ = adjusted()
    refused = GateJudgement(CalibrationProblem.NOISY, "marks <b>blurred</b>", camera_figures(adjustment))
    path = write_calibration_report(
        tmp_path,
        adjustment,
        refused,
        identity="a<b",
        rig="front_left",
        side="left",
        method="x & y",
        created_utc=NOON,
    )
    page = path.read_text(encoding="utf-8")
    assert "Refused." in page
    assert "marks &lt;b&gt;blurred&lt;/b&gt;" in page
    assert "a&lt;b" in page
    assert "x &amp; y" in page
