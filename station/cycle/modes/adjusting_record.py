"""What is stored of an adjusting: every adjuster that was turned, the vehicle as found and as left."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import get_args

from alignment.vehicle import WheelAngles
from db.records import AdjusterWord, AdjustingRecord, AdjustingWord, OutOfReachWord
from station.cycle.judging import Evaluation
from station.cycle.modes.guiding import Guiding
from station.guidance import GuidanceState, NutCorrection, WheelGuide

_ENDS: dict[GuidanceState, AdjustingWord] = {
    GuidanceState.DONE: "done",
    GuidanceState.UNREACHABLE: "unreachable",
}
_ADJUSTERS: dict[str, AdjusterWord] = {word: word for word in get_args(AdjusterWord)}
_REASONS: dict[str, OutOfReachWord] = {word: word for word in get_args(OutOfReachWord)}


def adjusting_records(guiding: Guiding, since_s: float) -> tuple[AdjustingRecord, ...]:
    """Return what was turned, as found; how it was left is not measured yet.

    Parameters
    ----------
    guiding
        Of an adjusting that ended, however it did.
    since_s
        When the trigger came, of the clock of the results.
    """
    found = []
    for (wheel, kind), (begun_s, ended_s) in guiding.times.items():
        guide = guiding.vehicle.wheels[wheel]
        done = [each for each in guide.corrections if each.adjuster is kind]
        if done:
            after_s = max(0.0, begun_s - since_s)
            found.append(_record(guide, done, after_s, max(after_s, ended_s - since_s)))
    return tuple(found)


def _record(
    guide: WheelGuide, done: Sequence[NutCorrection], begun_s: float, ended_s: float
) -> AdjustingRecord:
    assert guide.found is not None
    drifts = [each.locked - each.taken for each in done if each.taken is not None and each.locked is not None]
    return AdjustingRecord(
        wheel=guide.plan.wheel,
        adjuster=_ADJUSTERS[done[0].adjuster],
        outcome=_ENDS.get(guide.state, "unfinished"),
        reason=_REASONS.get(guide.reason),
        corrections=len(done),
        turns=math.fsum(each.turns for each in done),
        turns_made=math.fsum(abs(each.turns) for each in done),
        found_camber=float(guide.found.camber),
        found_toe=float(guide.found.toe),
        begun_s=float(begun_s),
        ended_s=float(ended_s),
        nuts_locked=len(drifts),
        drift=math.fsum(drifts) / len(drifts) if drifts else None,
    )


def as_left(records: Iterable[AdjustingRecord], evaluation: Evaluation) -> tuple[AdjustingRecord, ...]:
    """Return what was turned with the angles of the measurement that counts, where there is one."""
    values = {wheel.result.wheel: wheel.values for wheel in evaluation.wheels}
    return tuple(_left(record, values.get(record.wheel)) for record in records)


def _left(record: AdjustingRecord, angles: WheelAngles | None) -> AdjustingRecord:
    if angles is None:
        return record
    return replace(record, left_camber=float(angles.camber), left_toe=float(angles.toe))
