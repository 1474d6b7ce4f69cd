"""One folder of archived images, measured again as the station measured it; what every process runs."""

from __future__ import annotations

import hashlib
import json
import time
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from alignment.errors import FormatError, TruewheelError, told
from alignment.measure import measure_wheel
from alignment.measure_spin import SeriesMeasurement, SeriesUnderWay
from alignment.prepared import PreparedRig
from alignment.values import MeasureSettings, Refusal, WheelMeasurement
from alignment.wheel import SpinMeasurement
from sensors.formats import ArchivedResult, CalibrationFile, check_shot_matches, read_shot, validate
from sensors.shot import WheelShot
from station.cycle import corrected_and_judged
from station.replay.basis import ArchivedBasis, basis_of
from station.replay.compare import cause, differences, other_software
from station.replay.values import Cause, Choices, Difference, Job, Replayed, ReplayState
from station.store import environment, found_of

_MOST_RIGS = 16


class Measurer:
    """Measures folders again with the same choices; keeps the rigs that it prepared, of one process.

    Parameters
    ----------
    choices
        For all folders.
    """

    def __init__(self, choices: Choices) -> None:
        self._choices = choices
        self._rigs: OrderedDict[tuple[str, tuple[float, float]], PreparedRig] = OrderedDict()

    def replay(self, job: Job) -> Replayed:
        """Measure one folder again and compare it; whatever is wrong with it becomes part of the result."""
        try:
            return self._replay(job)
        except Exception as error:  # noqa: BLE001
            # A defect must be a line of the report, not the end of a run over a year.
            return Replayed(job.key, ReplayState.FAILED, lacks=(told(error),))

    def _replay(self, job: Job) -> Replayed:
        basis = basis_of(job)
        shots = self._shots(Path(job.folder), basis)
        done = Replayed(job.key, ReplayState.IDENTICAL, basis.wheel, basis.vin, basis.cycle)
        if shots:
            done = self._measured(done, basis, shots)
        done = replace(done, damage=tuple(basis.damage), lacks=tuple(basis.lacks))
        if done.damage:
            return replace(done, state=ReplayState.DAMAGED)
        if done.differences:
            return replace(done, state=ReplayState.DIFFERS)
        compared = done.measured and "outcome" in basis.result and not basis.partly
        return done if compared else replace(done, state=ReplayState.INCOMPLETE)

    def _shots(self, folder: Path, basis: ArchivedBasis) -> list[WheelShot]:
        """Read what is to be measured; empty where that cannot be."""
        if basis.rules is not None and basis.shots == (".",):
            basis.lacks.append("the exposures of its series: only the last one is archived")
            return []
        if not folder.is_dir():
            return []
        found = []
        for name in basis.shots:
            try:
                found.append(read_shot(folder / name))
            except FormatError as error:
                # A file that is known to be another one is told already.
                if not basis.damage:
                    basis.damage.append(str(error))
                return []
        basis.wheel = basis.wheel or found[0].rig
        return found

    def _measured(self, done: Replayed, basis: ArchivedBasis, shots: Sequence[WheelShot]) -> Replayed:
        wheel = basis.wheel or shots[0].rig
        given = self._choices.calibrations.get(wheel)
        document = given if given is not None else basis.document
        if document is None:
            basis.lacks.append("its calibration: give one of this rig")
            return replace(done, wheel=wheel)
        settings = self._choices.settings or basis.settings or MeasureSettings()
        known = basis.document
        other = known is None or (document is not known and _digest(document) != _digest(known))
        started = time.perf_counter()
        try:
            found = self._result(basis, wheel, shots, document, settings, zero=not other or given is None)
        except TruewheelError as error:
            # The cameras are others than those of this calibration.
            basis.lacks.append(str(error))
            return replace(done, wheel=wheel)
        duration_s = time.perf_counter() - started
        apart = self._apart(basis, found, other and basis.zero is not None and given is not None)
        causes: tuple[str, ...] = ()
        if apart:
            changed = _changed_choices(other and given is not None, document, known, settings, basis.settings)
            causes = self._causes(basis, wheel, shots, changed)
        return replace(
            done, wheel=wheel, differences=apart, causes=causes, measured=True, duration_s=duration_s
        )

    def _apart(
        self, basis: ArchivedBasis, found: ArchivedResult, without_zero: bool
    ) -> tuple[Difference, ...]:
        """Return the differences; of a result whose zero measurement belongs to another calibration too."""
        if without_zero and basis.zero is not None:
            basis.lacks.append(
                f"a zero measurement of the other calibration: that of {basis.zero.calibration_id} "
                f"({basis.zero.id}) corrected what is stored, and corrects nothing here"
            )
        return differences(basis.result, found, self._choices.within, basis.loose)

    def _causes(
        self, basis: ArchivedBasis, wheel: str, shots: Sequence[WheelShot], changed: dict[Cause, str]
    ) -> tuple[str, ...]:
        """Return what explains a difference.

        Where something was chosen and the program is another one too, it is measured once more as it was
        then: when that gives what is stored, the program has no part in the difference.
        """
        found = [cause(kind, what) for kind, what in changed.items()]
        if basis.changed_calibration and Cause.CALIBRATION not in changed:
            found.append(cause(Cause.CALIBRATION, "the archived one was changed"))
        if basis.changed:
            found.append(cause(Cause.IMAGES, ", ".join(basis.changed)))
        software = other_software(
            basis.software or "", basis.environment, version("truewheel"), environment()
        )
        if software is not None and not (changed and self._as_then(basis, wheel, shots)):
            found.append(cause(Cause.SOFTWARE, software))
        return tuple(found) or (cause(Cause.UNEXPLAINED),)

    def _as_then(self, basis: ArchivedBasis, wheel: str, shots: Sequence[WheelShot]) -> bool:
        """Whether this program finds what is stored with the calibration and the settings of then."""
        if basis.document is None or basis.settings is None:
            return False
        try:
            found = self._result(basis, wheel, shots, basis.document, basis.settings, zero=True)
        except TruewheelError:
            return False
        return not differences(basis.result, found, self._choices.within, basis.loose)

    def _result(
        self,
        basis: ArchivedBasis,
        wheel: str,
        shots: Sequence[WheelShot],
        document: Mapping[str, Any],
        settings: MeasureSettings,
        *,
        zero: bool,
    ) -> ArchivedResult:
        """Measure, correct and judge as the station does."""
        rig = self._rig(document, settings)
        for shot in shots:
            check_shot_matches(shot, rig.calibration)
        found, spin = _measure(shots, rig, settings, basis)
        applied = basis.zero if zero else None
        measurement, failure = corrected_and_judged(
            found, wheel, rig.calibration.side, applied, basis.needs_place
        )
        return found_of(measurement, failure, spin)

    def _rig(self, document: Mapping[str, Any], settings: MeasureSettings) -> PreparedRig:
        key = _digest(document), settings.depth_range_mm
        if key not in self._rigs:
            calibration = validate(CalibrationFile, document, file=None).calibration()
            self._rigs[key] = PreparedRig.of(calibration, settings)
            if len(self._rigs) > _MOST_RIGS:
                self._rigs.popitem(last=False)
        self._rigs.move_to_end(key)
        return self._rigs[key]


def _measure(
    shots: Sequence[WheelShot], rig: PreparedRig, settings: MeasureSettings, basis: ArchivedBasis
) -> tuple[WheelMeasurement | Refusal, SpinMeasurement | None]:
    if basis.rules is None:
        return measure_wheel(shots[0].images, rig, settings), None
    series = SeriesUnderWay(rig, settings, basis.rules, measure_wheel)
    for shot in shots:
        refusal = series.take(shot.frames[0].trigger_counter, shot.images)
        if refusal is not None:
            return refusal, None
    found = series.result()
    return (found.wheel, found.spin) if isinstance(found, SeriesMeasurement) else (found, None)


def _changed_choices(
    other: bool,
    document: Mapping[str, Any],
    known: Mapping[str, Any] | None,
    settings: MeasureSettings,
    before: MeasureSettings | None,
) -> dict[Cause, str]:
    """Return what was chosen otherwise than it was, and how."""
    changed: dict[Cause, str] = {}
    if other:
        was = "an unknown one" if known is None else str(known.get("id"))
        changed[Cause.CALIBRATION] = f"{document.get('id')} instead of {was}"
    if before is not None and settings != before:
        names = [name for name in vars(settings) if getattr(settings, name) != getattr(before, name)]
        changed[Cause.SETTINGS] = ", ".join(
            f"{name} {getattr(settings, name)} instead of {getattr(before, name)}" for name in names
        )
    return changed


def _digest(document: Mapping[str, Any]) -> str:
    text = json.dumps(document, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
