"""A gauge study as a person plans it on the command line."""

from __future__ import annotations

import math
from collections.abc import Sequence

from alignment.errors import ConfigurationError
from db.queries import Characteristic, Filter, ResultReader, known_names, require_known
from db.records import GaugeStudyRecord, StudyKind
from station.quality.gauge.store import plan_study

_LEAST_PARTS = {StudyKind.TYPE1: 1, StudyKind.STABILITY: 1, StudyKind.GRR: 2, StudyKind.LINEARITY: 2}
_ONE_PART = (StudyKind.TYPE1, StudyKind.STABILITY)
_CERTIFIED = (StudyKind.TYPE1, StudyKind.LINEARITY)


def plan_from_text(
    database: str,
    kind: str,
    name: str,
    characteristic: str,
    parts: Sequence[str],
    appraisers: Sequence[str],
    trials: int,
    tolerance_deg: float | None,
    station: str | None,
    seed: int,
) -> GaugeStudyRecord:
    """Check and store a plan; `parts` are ``VIN`` or ``VIN=DEGREES``.

    Raises
    ------
    ConfigurationError
        For an unknown kind, too few parts, or a certified angle that is missing or no number.
    InputError
        For a characteristic that is none, and one or a station that the database does not know.
    StoreError
        When the database fails.
    """
    if kind not in set(StudyKind):
        raise ConfigurationError(choice="kind", expected=f"one of {', '.join(StudyKind)}", seen=ascii(kind))
    study_kind = StudyKind(kind)
    references: dict[str, float] = {}
    names = []
    for text in parts:
        vin, sign, angle = text.partition("=")
        names.append(vin)
        if sign:
            references[vin] = _radians(text, angle)
        elif study_kind in _CERTIFIED:
            raise ConfigurationError(choice="part", expected="VIN=DEGREES, the certified angle", seen=text)
    least = _LEAST_PARTS[study_kind]
    if len(names) < least or (study_kind in _ONE_PART and len(names) > 1):
        wanted = "one part" if study_kind in _ONE_PART else f"at least {least} parts"
        raise ConfigurationError(choice="part", expected=wanted, seen=str(len(names)))
    wanted_angle = Characteristic.parse(characteristic)
    with ResultReader(database) as reader:
        # A plan is made before its cycles; where nothing was measured yet, any angle may come.
        measured = known_names(reader).characteristics
        require_known(
            reader,
            Filter(stations=() if station is None else (station,)),
            (wanted_angle,) if measured else (),
        )
    return plan_study(
        database,
        study_kind,
        name,
        wanted_angle,
        names,
        appraisers=appraisers,
        trials=trials,
        references=references,
        tolerance=None if tolerance_deg is None else math.radians(tolerance_deg),
        station=station,
        seed=seed,
    )


def _radians(text: str, angle: str) -> float:
    try:
        degrees = float(angle)
    except ValueError:
        degrees = math.nan
    if not -10.0 <= degrees <= 10.0:
        raise ConfigurationError(choice="part", expected="an angle of -10 to 10 degrees", seen=text)
    return math.radians(degrees)
