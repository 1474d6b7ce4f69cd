"""Gauge repeatability and reproducibility: analysis of variance, and average and range.

Source: AIAG, Measurement Systems Analysis, 4th edition, chapter III. Without appraisers (type 3, the study of
an automatic station) parts are the only factor, and reproducibility is zero by definition.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.statistics.anova import Source, one_way, tested_against, two_way
from alignment.statistics.choices import GrrMethod
from alignment.statistics.constants import chart_constants, d2_star
from alignment.statistics.summary import mean_of

POOLING_P = 0.25
"""An interaction is kept when it would arise by chance with less than this probability (AIAG)."""
ACCEPTABLE_PERCENT, CONDITIONAL_PERCENT, LEAST_NDC = 10.0, 30.0, 5
"""AIAG: up to 10 % acceptable, up to 30 % conditionally; five categories at least."""
USUAL_PARTS = 10
"""Of a complete study."""


@dataclass(frozen=True, eq=False)
class GaugeData:
    """Values of a crossed study, all of one length.

    Attributes
    ----------
    parts
        Name of the part of each value.
    values
        (N,) float64, all of one unit.
    appraisers
        Who measured, for each value; None for a study without.
    offset
        What was subtracted from the values to keep their digits; studies report it back in means.
    """

    parts: Sequence[str]
    values: Array
    appraisers: Sequence[str] | None = None
    offset: float = 0.0


@dataclass(frozen=True)
class GrrResult:
    """Components of a gauge study, as standard deviations in the unit of the values.

    Attributes
    ----------
    method
        How they were found.
    parts, appraisers, trials
        Size of the study; `appraisers` 0 for a study without; `trials` None where parts have different
        numbers.
    repeatability
        Equipment variation: the same part, the same appraiser.
    reproducibility
        Between appraisers, their interaction with the parts included.
    appraiser, interaction
        The two parts of reproducibility; by average and range the interaction cannot be told.
    part_variation
        Between parts.
    interaction_p
        Chance probability of the interaction; 0 where no trial was repeated differently, so that it is none;
        None where not tested.
    pooled
        Whether the interaction was taken into repeatability.
    table
        The analysis of variance; empty by average and range.
    multiplier
        Study variation in standard deviations: 6.
    tolerance
        Width of the tolerance, or None.
    mean
        Of all values.
    repeated_differently
        Whether any repetition of a part by an appraiser differs from another; where none does, the gauge
        showed no repeatability, which is not one of zero.
    """

    method: GrrMethod
    parts: int
    appraisers: int
    trials: int | None
    repeatability: float
    reproducibility: float
    appraiser: float
    interaction: float
    part_variation: float
    interaction_p: float | None
    pooled: bool
    table: tuple[Source, ...]
    multiplier: float
    tolerance: float | None
    mean: float
    repeated_differently: bool

    @property
    def grr(self) -> float:
        """Repeatability and reproducibility together."""
        return math.hypot(self.repeatability, self.reproducibility)

    @property
    def total_variation(self) -> float:
        """Gauge and parts together."""
        return math.hypot(self.grr, self.part_variation)

    @property
    def ndc(self) -> int | None:
        """Number of distinct categories, rounded down; None for a gauge without any variation."""
        return math.floor(1.41 * self.part_variation / self.grr) if self.grr > 0.0 else None

    def percent_study_variation(self, component: float) -> float | None:
        """A component over the total variation; None where nothing varies."""
        return 100.0 * component / self.total_variation if self.total_variation > 0.0 else None

    def percent_tolerance(self, component: float) -> float | None:
        """A component's study variation over the tolerance; None without one."""
        return None if self.tolerance is None else 100.0 * self.multiplier * component / self.tolerance


def grr(
    data: GaugeData,
    method: GrrMethod = GrrMethod.ANOVA,
    *,
    tolerance: float | None = None,
    multiplier: float = 6.0,
    pooling_p: float = POOLING_P,
) -> GrrResult:
    """Components of a gauge study.

    Parameters
    ----------
    data
        With appraisers every appraiser measures every part the same number of times. Without, the analysis
        of variance takes parts of different numbers of values; average and range does not.
    tolerance
        Width of the tolerance, in the unit of the values.
    multiplier
        Width of study variation in standard deviations; AIAG 6, formerly 5.15.
    pooling_p
        Least chance probability of an interaction that is taken into repeatability.

    Raises
    ------
    DegenerateInputError
        For too few parts, appraisers or trials, or a pair without its values, which is named.
    """
    if tolerance is not None and not tolerance > 0.0:
        raise DegenerateInputError(field="tolerance", expected="a width greater than 0", seen=f"{tolerance}")
    if data.appraisers is None:
        return _without_appraisers(data, method, tolerance, multiplier)
    cube = crossed(data)
    if method is GrrMethod.RANGE:
        return _average_and_range(data, cube, tolerance, multiplier)
    return _analysis(data, cube, tolerance, multiplier, pooling_p)


def crossed(data: GaugeData) -> Array:
    """(P, A, R) values of parts, appraisers and trials, in the order of first appearance.

    Raises
    ------
    DegenerateInputError
        When a pair lacks values or has more than others, or there are fewer than two of anything.
    """
    appraisers = data.appraisers if data.appraisers is not None else [""] * len(data.parts)
    cells: dict[tuple[str, str], list[float]] = {}
    for part, appraiser, value in zip(data.parts, appraisers, data.values, strict=True):
        cells.setdefault((part, appraiser), []).append(float(value))
    part_names, names = list(dict.fromkeys(data.parts)), list(dict.fromkeys(appraisers))
    wanted = max((len(cell) for cell in cells.values()), default=0)
    if len(part_names) < 2:
        raise DegenerateInputError(field="part", expected="at least 2 parts", seen=str(len(part_names)))
    if data.appraisers is not None and len(names) < 2:
        raise DegenerateInputError(
            field="appraiser",
            expected="at least 2 appraisers",
            seen=", ".join(names) or "none",
            cure="Leave the appraiser out for a study without (type 3)",
        )
    if wanted < 2:
        raise DegenerateInputError(field="trial", expected="at least 2 trials", seen=str(wanted))
    for part in part_names:
        for name in names:
            found = len(cells.get((part, name), ()))
            if found != wanted:
                of = f" of appraiser {name!r}" if name else ""
                raise DegenerateInputError(
                    expected=f"{wanted} values{of} for part {part!r}, as elsewhere", seen=str(found)
                )
    return np.array([[cells[part, name] for name in names] for part in part_names])


def _analysis(
    data: GaugeData, cube: Array, tolerance: float | None, multiplier: float, pooling_p: float
) -> GrrResult:
    parts, appraisers, trials = cube.shape
    found = two_way(cube, "part", "appraiser")
    interaction_p = found.interaction.p
    pooled = interaction_p is None or interaction_p > pooling_p
    if pooled:
        residual = Source(
            "repeatability",
            found.residual.df + found.interaction.df,
            found.residual.squares + found.interaction.squares,
        )
        table: tuple[Source, ...] = (
            tested_against(found.first, residual),
            tested_against(found.second, residual),
            residual,
            found.total,
        )
        base, between = residual.mean_square, 0.0
    else:
        residual = found.residual
        table = (found.first, found.second, found.interaction, residual, found.total)
        base = found.interaction.mean_square
        between = max(0.0, (base - residual.mean_square) / trials)
    appraiser = max(0.0, (found.second.mean_square - base) / (parts * trials))
    part = max(0.0, (found.first.mean_square - base) / (appraisers * trials))
    return GrrResult(
        GrrMethod.ANOVA,
        parts,
        appraisers,
        trials,
        repeatability=math.sqrt(residual.mean_square),
        reproducibility=math.sqrt(appraiser + between),
        appraiser=math.sqrt(appraiser),
        interaction=math.sqrt(between),
        part_variation=math.sqrt(part),
        interaction_p=interaction_p,
        pooled=pooled,
        table=table,
        multiplier=multiplier,
        tolerance=tolerance,
        mean=_mean(data),
        repeated_differently=_repeated_differently(data),
    )


def _average_and_range(data: GaugeData, cube: Array, tolerance: float | None, multiplier: float) -> GrrResult:
    parts, appraisers, trials = cube.shape
    # Means of equal values are then equal, whatever their digits.
    cube = cube - cube.min()
    mean_range = float(np.ptp(cube, axis=2).mean())
    difference = float(np.ptp(cube.mean(axis=(0, 2)))) if appraisers > 1 else 0.0
    part_range = float(np.ptp(cube.mean(axis=(1, 2))))
    equipment, appraiser, part = range_components(
        mean_range, difference, part_range, trials=trials, appraisers=appraisers, parts=parts
    )
    return GrrResult(
        GrrMethod.RANGE,
        parts,
        appraisers if data.appraisers is not None else 0,
        trials,
        repeatability=equipment,
        reproducibility=appraiser,
        appraiser=appraiser,
        interaction=0.0,
        part_variation=part,
        interaction_p=None,
        pooled=False,
        table=(),
        multiplier=multiplier,
        tolerance=tolerance,
        mean=_mean(data),
        repeated_differently=_repeated_differently(data),
    )


def range_components(
    mean_range: float, difference: float, part_range: float, *, trials: int, appraisers: int, parts: int
) -> tuple[float, float, float]:
    """Equipment, appraiser and part variation from the figures of the average-and-range sheet.

    Parameters
    ----------
    mean_range
        Mean of the ranges of all pairs of part and appraiser.
    difference
        Greatest less smallest mean of an appraiser; unused for one appraiser.
    part_range
        Greatest less smallest mean of a part.
    """
    equipment = mean_range / chart_constants(trials).d2
    appraiser = 0.0
    if appraisers > 1:
        spread = difference / d2_star(appraisers, 1)
        appraiser = math.sqrt(max(0.0, spread**2 - equipment**2 / (parts * trials)))
    return equipment, appraiser, part_range / d2_star(parts, 1)


def _without_appraisers(
    data: GaugeData, method: GrrMethod, tolerance: float | None, multiplier: float
) -> GrrResult:
    if method is GrrMethod.RANGE:
        return _average_and_range(data, crossed(data), tolerance, multiplier)
    names = list(dict.fromkeys(data.parts))
    place = {name: number for number, name in enumerate(names)}
    owner = np.array([place[part] for part in data.parts])
    groups = [data.values[owner == number] for number in range(len(names))]
    found = one_way(groups, "part", "repeatability")
    sizes = {len(group) for group in groups}
    total = Source(
        "total", found.between.df + found.within.df, math.fsum((found.between.squares, found.within.squares))
    )
    part = max(0.0, (found.between.mean_square - found.within.mean_square) / found.n0)
    return GrrResult(
        GrrMethod.ANOVA,
        len(names),
        0,
        sizes.pop() if len(sizes) == 1 else None,
        repeatability=math.sqrt(found.within.mean_square),
        reproducibility=0.0,
        appraiser=0.0,
        interaction=0.0,
        part_variation=math.sqrt(part),
        interaction_p=None,
        pooled=False,
        table=(found.between, found.within, total),
        multiplier=multiplier,
        tolerance=tolerance,
        mean=_mean(data),
        repeated_differently=_repeated_differently(data),
    )


def _mean(data: GaugeData) -> float:
    return data.offset + mean_of(data.values)


def _repeated_differently(data: GaugeData) -> bool:
    appraisers = data.appraisers if data.appraisers is not None else [""] * len(data.parts)
    first: dict[tuple[str, str], float] = {}
    return any(
        first.setdefault((part, appraiser), float(value)) != value
        for part, appraiser, value in zip(data.parts, appraisers, data.values, strict=True)
    )
