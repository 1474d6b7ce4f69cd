import json

import pytest

from station.cli import main
from station.rehearsal import benchmark


@pytest.mark.slow
def test_bench_prints_its_figures_and_says_by_its_status_whether_goals_are_met(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(benchmark, "MOST_MS", 0.0)
    with pytest.raises(SystemExit) as end:
        main(["bench", "--repeats", "1", "--warm-up", "0", "--json"])
    assert end.value.code == 1
    printed = json.loads(capsys.readouterr().out)
    figures = printed["figures"]
    assert {"measure_wheel_ms", "speedup_over_sgbm_ransac", "ratio_to_gaussian_blur"} <= figures.keys()
    stages = [figures[f"{stage}_ms"] for stage in benchmark.TIMED_STAGES]
    assert all(value > 0.0 for value in stages)
    assert abs(figures["camber_error_arcmin"]) < 0.1
    assert abs(figures["toe_error_arcmin"]) < 0.1


@pytest.mark.parametrize(
    ("figure", "value"),
    [("measure_wheel_ms", 26.0), ("speedup_over_sgbm_ransac", 59.0), ("peak_memory_mb", 1001.0)],
)
def test_one_missed_figure_misses_the_goal(figure: str, value: float) -> None:
    good = {"measure_wheel_ms": 20.0, "speedup_over_sgbm_ransac": 70.0, "peak_memory_mb": 400.0}
    assert benchmark.goals(good)
    assert not benchmark.goals(good | {figure: value})
