"""The studies of calibration methods, in their quick form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from station.figures import StudyResult
from station.studies import correction, parallel_head
from station.studies.lenz_tsai import STUDY as LENZ_TSAI
from station.studies.nonparallel_head import STUDY as NONPARALLEL_HEAD


def silent(done: float, doing: str) -> None:
    assert 0.0 <= done <= 1.0
    assert doing


def assert_goals_met(result: StudyResult) -> None:
    assert not result.missed, [(str(goal), result.figures[goal.figure]) for goal in result.missed]
    assert all(list(row) == list(result.rows[0]) for row in result.rows)


def test_lenz_tsai() -> None:
    result = LENZ_TSAI.run(3, True, silent)
    assert_goals_met(result)
    rows = [r for r in result.rows if r["errors_of"] == "points" and r["size"] == 0.0]
    lenz = [float(r["lenz_mm"] or 0.0) for r in rows]
    assert lenz == sorted(lenz)
    assert lenz[0] < 1e-6


@pytest.mark.slow
def test_nonparallel_head() -> None:
    result = NONPARALLEL_HEAD.run(1, True, silent)
    assert_goals_met(result)
    assert result.figures["joint_z_largest_before_mm"] < result.figures["two-system_z_largest_before_mm"]


@pytest.mark.slow
def test_parallel_head() -> None:
    """One head; the arctangent edges, two seconds an image, are left to the study itself."""
    lines = [line for line in parallel_head.LINES if line.marks != "arctan_edges"]
    found = parallel_head.errors_of_head(np.random.default_rng(2), lines)
    assert {len(errors.points) for errors in found.values()} == {25}
    assert found["joint_ellipse"].largest < parallel_head.LARGEST_UM
    assert 1.5 * found["joint_ellipse"].largest < found["own_weight_point"].largest < 300.0
    assert found["own_plain"].largest < 350.0


def test_parallel_head_reports_failed_calibrations() -> None:
    rng = np.random.default_rng(1)

    def errors_of_head(_: np.random.Generator) -> dict[str, parallel_head.HeadErrors]:
        sizes = {"own_plain": 90.0, "own_weight_point": 80.0, "own_subpixel": 20.0, "joint_ellipse": 8.0}
        drawn = {name: size * rng.normal(size=(100, 3)) for name, size in sizes.items()}
        return {name: parallel_head.HeadErrors(e[:25], e) for name, e in drawn.items()}

    result = parallel_head.run_heads(2, 0, silent, errors_of_head)
    assert result.figures["lenz_without_result"] == 2
    assert [goal.figure for goal in result.missed] == ["lines_better_than_the_one_before"]


def test_same_seed_same_result() -> None:
    one, two = (dict(LENZ_TSAI.run(5, True, silent).figures) for _ in range(2))
    assert one == two


def test_correction_of_the_printed_errors() -> None:
    if not any((place / correction.FILE).is_file() for place in correction.PLACES):
        pytest.skip(f"printed errors not present: no {correction.FILE} beside the project")
    assert_goals_met(correction.STUDY.run(0, True, silent))


def test_correction_without_the_table_says_where_to_put_it(tmp_path: Path) -> None:
    with pytest.raises(correction.ConfigurationError, match="current folder"):
        correction.run_table((tmp_path,), True, silent)
    (tmp_path / correction.FILE).write_text("x,y,ex\n0,0,1\n", encoding="utf-8")
    with pytest.raises(correction.ConfigurationError, match="3 columns"):
        correction.run_table((tmp_path,), True, silent)
