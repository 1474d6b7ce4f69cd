"""Contributions to an uncertainty budget: written down, and found by gauge studies."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from alignment.errors import ConfigurationError, DegenerateInputError
from alignment.statistics import (
    LEAST_VALUES,
    USUAL_VALUES,
    Component,
    Contribution,
    GaugeData,
    GrrMethod,
    bias_uncertainty,
    deviations,
    grr,
    moments,
    resolution_uncertainty,
)
from db.records import StudyKind
from station.quality.gauge.file import read_budget_file, read_gauge_file, without_appraiser
from station.quality.gauge.source import GAUGE_COLUMNS, GaugeSource


def collect_components(
    written: Path | None,
    type1_file: Path | None,
    reference: float | None,
    grr_file: Path | None,
    resolution: float | None,
    calibration_u: float | None,
) -> list[Component]:
    """All contributions that are given.

    Parameters
    ----------
    written
        Table of contributions.
    type1_file, reference
        Repetitions on one master: EVR; against its certified value: BI.
    grr_file
        Study with or without appraisers, by analysis of variance: EVO, AV, IA.
    resolution, calibration_u
        Resolution of the gauge: RE; standard uncertainty of its calibration: CAL.

    Raises
    ------
    ConfigurationError
        When nothing is given.
    InputError
        For a file that is no table of its kind.
    """
    found = [] if written is None else read_budget_file(written)
    if resolution is not None:
        found.append(Component(Contribution.RESOLUTION, resolution_uncertainty(resolution), "resolution"))
    if calibration_u is not None:
        found.append(Component(Contribution.CALIBRATION, calibration_u, "calibration"))
    if type1_file is not None:
        found += _of_type1(type1_file, reference)
    if grr_file is not None:
        found += _of_grr(grr_file)
    if not found:
        raise ConfigurationError(
            choice="from file, type1 file, grr file, resolution, calibration u",
            expected="at least one contribution",
            seen="none",
        )
    return found


def _of_type1(file: Path, reference: float | None) -> list[Component]:
    rows = read_gauge_file(file, GAUGE_COLUMNS[StudyKind.TYPE1])
    with GaugeSource(str(file), rows, "", {}).named_in_errors():
        offset, values = deviations([row.value for row in rows])
        if len(values) < LEAST_VALUES:
            raise DegenerateInputError(
                expected=f"at least {LEAST_VALUES} repetitions",
                seen=str(len(values)),
                cure=f"{USUAL_VALUES} are usual",
            )
        repeated = moments(values)
        found = [Component(Contribution.MASTER_REPEATABILITY, repeated.deviation, f"{file.name}, type 1")]
    if reference is not None:
        bias = offset - reference + repeated.mean
        found.append(Component(Contribution.BIAS, bias_uncertainty(bias), f"{file.name}, type 1"))
    return found


def _of_grr(file: Path) -> list[Component]:
    rows = read_gauge_file(file, GAUGE_COLUMNS[StudyKind.GRR])
    with GaugeSource(str(file), rows, "", {}).named_in_errors():
        offset, values = deviations([row.value for row in rows])
        appraisers = None if without_appraiser(rows) else [row.appraiser for row in rows]
        result = grr(
            GaugeData([row.part for row in rows], np.asarray(values), appraisers, offset), GrrMethod.ANOVA
        )
    source = f"{file.name}, GRR"
    found = [Component(Contribution.PART_REPEATABILITY, result.repeatability, source)]
    if appraisers is not None:
        found.append(Component(Contribution.APPRAISER, result.appraiser, source))
        found.append(Component(Contribution.INTERACTION, result.interaction, source))
    return found
