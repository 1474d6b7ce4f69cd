"""Images of the calibration plate, recorded when the line asks for them: one shot of each rig per start.

Each start makes a folder named after its time and number, with one recorded shot per rig in it, which
`truewheel calibrate` and every other reader of shots can take up. Nothing is judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from datetime import datetime
from pathlib import Path

from alignment.errors import TruewheelError
from sensors.formats.shot import write_shot
from station.line.messages import LineErrorCode, Outcome, WheelAnswer
from station.ports import Bounds
from station.wheels import WheelPosition


class CalibrationImages:
    """Records shots.

    Parameters
    ----------
    folder
        Where the folders of the starts go; made when it is missing.
    threads
        At least one for each position.
    bounds
        Of the waiting for all images.
    """

    def __init__(self, folder: Path, threads: ThreadPoolExecutor, bounds: Bounds) -> None:
        self._folder = folder
        self._threads = threads
        self._measure_s = bounds.measure_s

    def record(
        self, positions: Sequence[WheelPosition], sequence: int, now: datetime
    ) -> tuple[tuple[WheelAnswer, ...], LineErrorCode, str]:
        """Shoot and write; the answers, the error code of the first failure, and what to put down of it."""
        folder = self._folder / f"{now:%Y-%m-%dT%H-%M-%S}-{sequence:03d}"
        futures = {self._threads.submit(self._one, position, folder): position for position in positions}
        done, late = wait_for(futures, self._measure_s)
        failures = [failure for future in done if (failure := _failure(future, futures[future])) is not None]
        failures += [
            (LineErrorCode.CYCLE_TIMEOUT, futures[future].name, "its images took too long") for future in late
        ]
        failed = {wheel for _, wheel, _ in failures}
        answers = tuple(
            WheelAnswer(p.name, Outcome.FAULT if p.name in failed else Outcome.RECORDED) for p in positions
        )
        text = "; ".join(f"{wheel}: {reason}" for _, wheel, reason in failures)
        code = failures[0][0] if failures else LineErrorCode.NONE
        return answers, code, f"images of {len(positions) - len(failed)} rigs in {folder}. {text}".strip()

    def _one(self, position: WheelPosition, folder: Path) -> None:
        position.rig.arm()
        shot = position.rig.shoot(self._measure_s)
        folder.mkdir(parents=True, exist_ok=True)
        write_shot(folder / position.name, shot)


def _failure(future: Future[None], position: WheelPosition) -> tuple[LineErrorCode, str, str] | None:
    error = future.exception()
    if error is None:
        return None
    camera = isinstance(error, TruewheelError) and not isinstance(error, ValueError)
    code = LineErrorCode.CAMERA_FAULT if camera else LineErrorCode.STORE_FAULT
    return code, position.name, str(error)
