"""How the study of false alarms and misses scores, and that its knocks do what they say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from alignment.calibration.refreshing import Refreshed
from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from station.studies.refresh import angle_errors
from station.studies.refresh_rates import KNOCKS, DrawnKnock, judged_refresh, scored, with_drawn_knock
from tests.station.calibrations import adjusted, true_rig


def row(kind: str, said: str, missed: int = 0, beyond: int = 0) -> dict[str, Any]:
    return {
        "kind": kind, "said": said, "contradiction": 0.3, "error_arcmin": 0.1, "stated_arcmin": 0.02,
        "unseen_arcmin": 0.2, "missed": missed, "beyond_unseen": beyond,
    }  # fmt: skip


def test_each_kind_is_counted_by_itself() -> None:
    rows = [
        *[row("intact", "unchanged")] * 98,
        row("intact", "camera"),
        row("intact", "plate"),
        row("camera turn x 0.5", "camera"),
        row("camera turn x 0.5", "unchanged", missed=1),
        row("head shift z 0.1", "unchanged", missed=1, beyond=1),
        row("head shift z 0.1", "camera"),
    ]
    result = scored(rows, 4)
    figures = result.figures
    assert figures["false_alarms"] == 0.02
    assert (figures["camera_missed"], figures["camera_beyond_unseen"]) == (0.5, 0.0)
    assert (figures["head_missed"], figures["head_beyond_unseen"], figures["head_called_camera"]) == (
        0.5,
        0.5,
        0.5,
    )
    assert {goal.figure for goal in result.missed} == {
        "false_alarms",
        "head_beyond_unseen",
        "head_called_camera",
    }
    assert "| camera turn x 0.5 | 2 | 1 | 0 | 1 | 1 | 0 |" in result.text
    assert "| head shift z 0.1 | 2 | 1 | 0 | 1 | 1 | 1 |" in result.text


def test_all_kinds_of_knocks_are_there() -> None:
    assert len({knock.kind for knock in KNOCKS}) == len(KNOCKS) == 2 * 2 * 3 * 4
    assert 9 * len(KNOCKS) >= 400


@pytest.mark.parametrize("how", ["turn", "shift"])
def test_a_knocked_head_keeps_its_cameras_to_one_another_and_a_knocked_camera_does_not(how: str) -> None:
    true = true_rig()
    size = 5.0 if how == "turn" else 0.5
    for body, rigid in (("head", True), ("camera", False)):
        now = with_drawn_knock(true, DrawnKnock(body, how, "x", size), np.random.default_rng(2))
        (moved,) = [k for k in range(3) if now.heads[k] is not true.heads[k]]
        between = [
            rig.heads[moved].left.rig_from_camera.inverse() @ rig.heads[moved].right.rig_from_camera
            for rig in (true, now)
        ]
        apart = between[0].inverse() @ between[1]
        same = np.linalg.norm(apart.rotvec()) < 1e-12 and np.linalg.norm(apart.translation) < 1e-9
        assert same == rigid
        if how == "turn":
            poses = [
                (rig.heads[moved].left.rig_from_camera, rig.heads[moved].right.rig_from_camera)
                for rig in (true, now)
            ]
            turns = [np.linalg.norm((a.inverse() @ b).rotvec()) for a, b in zip(*poses, strict=True)]
            assert max(turns) == pytest.approx(size * ARCMIN)
    assert with_drawn_knock(true, DrawnKnock(), np.random.default_rng(2)) is true


def test_a_miss_is_an_error_beyond_what_is_stated() -> None:
    _, calibration = adjusted()
    now = with_drawn_knock(calibration, DrawnKnock("camera", "turn", "y", 5.0), np.random.default_rng(2))
    error = float(np.abs(angle_errors(now, true_rig())).max())

    def said(unseen: float) -> Any:
        silent = Refreshed((), None, None, np.zeros(2), 0.0, 3, now, 0.5, unseen=np.array([0.0, unseen]))
        return judged_refresh((), now, true_rig(), DrawnKnock("camera", "turn", "y", 5.0), lambda *_: silent)

    assert error > ARCMIN
    assert (said(0.0)["missed"], said(0.0)["beyond_unseen"]) == (1, 1)
    assert (said(0.6 * error)["missed"], said(0.6 * error)["beyond_unseen"]) == (1, 0)

    def refuse(*_: object) -> Refreshed:
        raise DegenerateInputError(field="shots", expected="one", seen="two")

    told = judged_refresh((), now, true_rig(), DrawnKnock("camera", "turn", "y", 5.0), refuse)
    assert (told["said"], told["missed"]) == ("plate", 0)


def test_a_calibration_with_its_own_errors_is_no_miss() -> None:
    _, calibration = adjusted()
    silent = Refreshed((), None, None, np.zeros(2), 0.0, 3, calibration, 0.5, unseen=np.zeros(2))
    assert judged_refresh((), calibration, true_rig(), DrawnKnock(), lambda *_: silent)["missed"] == 0
