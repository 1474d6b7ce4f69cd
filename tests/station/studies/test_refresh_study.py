"""How the study of knocked cameras scores; the refresh itself is tested with rendered wheels elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from alignment.calibration.refreshing import Moved, Refreshed
from alignment.values import MeasureSettings, RigCalibration, StereoImages
from station.studies import refresh as study


def silent(done: float, doing: str) -> None:
    assert 0.0 <= done <= 1.0
    assert doing


def no_picture(now: RigCalibration, rng: np.random.Generator) -> tuple[StereoImages, ...]:
    return ()


def test_a_refresh_that_finds_the_camera_and_its_pose_meets_the_goals() -> None:
    drawn: list[study.KnockedRig] = []

    def knocked_rig(rng: np.random.Generator) -> study.KnockedRig:
        drawn.append(study.knocked_rig(rng))
        return drawn[-1]

    def refresh(
        shots: Sequence[Sequence[StereoImages]], known: RigCalibration, settings: MeasureSettings
    ) -> Refreshed:
        assert len(shots) == study.QUICK_SHOTS
        before, now, camera = drawn[-1]
        assert known is before
        moved = Moved(camera, np.zeros(6), 0.0, 1.0)
        return Refreshed((), moved, None, np.zeros(2), 0.0, 3, replace(now, covariance=known.covariance))

    result = study.run_rigs(
        study.QUICK_RIGS,
        study.QUICK_SHOTS,
        3,
        silent,
        knock=knocked_rig,
        picture=no_picture,
        estimate=refresh,
    )
    assert not result.missed
    assert result.figures["cameras_found"] == 1.0
    assert result.figures["before_rms_arcmin"] > 0.5
    assert result.figures["along_rms_arcmin"] < 1e-9
    assert {row["camera"] for row in result.rows} == {" ".join(camera) for _, _, camera in drawn}


def test_a_refresh_that_finds_nothing_misses_them() -> None:
    def refresh(
        shots: Sequence[Sequence[StereoImages]], known: RigCalibration, settings: MeasureSettings
    ) -> Refreshed:
        return Refreshed((), None, None, np.zeros(2), 0.0, 0, known)

    result = study.run_rigs(
        study.QUICK_RIGS, study.QUICK_SHOTS, 3, silent, picture=no_picture, estimate=refresh
    )
    assert {goal.figure for goal in result.missed} >= {"cameras_found", "along_over_predicted"}
    assert result.figures["cameras_found"] == 0.0
