"""The study of knocked rigs in short, and the table of mixed pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from alignment.values import StereoImages
from sensors.simulation.scene import WheelScene
from station.figures import Row, StudyResult
from station.studies import knocked, mixtures
from station.studies.degraded import with_mixtures
from station.studies.wheels import study_rig


def silent(done: float, doing: str) -> None:
    assert 0.0 <= done <= 1.0
    assert doing


@pytest.mark.slow
def test_knocks_of_every_kind_are_told_and_intact_rigs_are_not() -> None:
    result = knocked.run(1, True, silent)
    assert result.figures["intact_rigs"] == knocked.QUICK_RIGS
    assert result.figures["knocked_rigs"] == len(knocked.KNOCK_KINDS)
    assert result.figures["false_alarm_share"] == 0.0
    assert result.figures["highest_intact_evidence"] < -2.0
    by_kind = {str(row["kind"]): row for row in result.rows if row["kind"]}
    assert set(by_kind) == set(map(str, knocked.KNOCK_KINDS))
    # A camera alone is always seen; of a whole head what slides along the tyre is not.
    for kind in knocked.KNOCK_KINDS:
        if not kind.whole_head and kind.turns:
            assert by_kind[str(kind)]["outcome"] != "measured"
    assert result.plots


def test_mixtures_are_thirty_and_no_two_alike() -> None:
    calls: list[WheelScene] = []

    def pictures(_: object, scene: WheelScene, rng: np.random.Generator) -> list[StereoImages]:
        calls.append(scene)
        return [StereoImages(*rng.integers(0, 256, (2, 64, 64), dtype=np.uint8)) for _ in range(3)]

    scene, mixed = mixtures.mixtures(study_rig("standard", 1), 1, pictures)
    assert scene is calls[0]
    assert len({each.name for each in mixed}) == len(mixed) == 30
    shown = {b"".join(p.left.tobytes() + p.right.tobytes() for p in each.images) for each in mixed}
    assert len(shown) == 30


def rows(outcomes: Sequence[tuple[str, float, float]]) -> list[Row]:
    return [
        {
            "kind": f"kind {k}",
            "outcome": outcome,
            "reason": "head_moved" if outcome == "refused" else None,
            "largest_error_arcmin": None if outcome == "refused" else error,
            "error_over_u": None if outcome == "refused" else ratio,
        }
        for k, (outcome, error, ratio) in enumerate(outcomes)
    ]


def test_mixtures_beyond_three_deviations_are_counted_warned_or_not() -> None:
    before = StudyResult((), {"shots": 1.0}, (), "Text.", {})
    result = with_mixtures(
        before,
        rows([("refused", 0, 0), ("measured", 1.5, 200.0), ("warned", 0.2, 3.5), ("warned", 0.2, 2.5)]),
    )
    assert result.figures["mixtures_beyond_three_sigma"] == 2.0
    assert result.figures["mixtures_measured"] == 1.0
    assert result.figures["largest_mixture_error_arcmin"] == 1.5
    assert "| kind 0 | refused (head_moved) | | |" in result.text
    assert "| kind 2 | warned | 0.200 | 3.5 |" in result.text
