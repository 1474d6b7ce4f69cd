"""Gauge studies as a person and a program read them: figures, limits, tables, sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

import numpy as np

from alignment.arrays import Array
from alignment.counting import count_of
from alignment.errors import DegenerateInputError
from alignment.statistics import (
    ACCEPTABLE_PERCENT,
    ALL_EQUAL,
    CONDITIONAL_PERCENT,
    CURE,
    LARGEST_RESOLUTION_PERCENT,
    LEAST_CG,
    LEAST_NDC,
    LEAST_POINTS,
    LIMIT_MP,
    LIMIT_MS,
    POOLING_P,
    USUAL_PARTS,
    USUAL_POINTS,
    USUAL_VALUES,
    ChartKind,
    Component,
    Conclusion,
    GaugeData,
    GrrMethod,
    GrrResult,
    RuleSet,
    StabilityResult,
    UncertaintyBudget,
    budget,
    coarse_step,
    deviations,
    grr,
    linearity,
    rule_source,
    stability,
    type1,
)
from station.figures import Goal, Row, StudyResult
from station.quality.gauge import pictures
from station.quality.gauge.file import GaugeRow, without_appraiser


@dataclass(frozen=True, eq=False)
class GaugeReport:
    """A study and what stands beside its figures.

    Attributes
    ----------
    name, summary
        As its files are called, and one line of what it is.
    result
        Table, figures, limits, text, plots; figures are in the unit of the values.
    facts
        JSON values beside the figures: method, sizes, table of the analysis.
    assessment
        The verdict in one sentence.
    no_verdict
        Whether nothing was seen that could be judged; figures with limits are then not a number.
    """

    name: str
    summary: str
    result: StudyResult
    facts: dict[str, Any]
    assessment: str
    no_verdict: bool = False

    @property
    def judgement(self) -> Conclusion:
        """Whether the gauge has shown what was asked of it."""
        if self.no_verdict:
            return Conclusion.NONE
        return Conclusion.NOT_SHOWN if self.result.missed else Conclusion.SHOWN

    def as_json(self) -> dict[str, Any]:
        """What `--json` prints, but for the files."""
        return {
            "study": self.name.removeprefix("gauge-"),
            **self.facts,
            "verdict": str(self.judgement),
            "assessment": self.assessment,
            **self.result.as_json(),
        }


def analyse_grr(
    rows: Sequence[GaugeRow],
    method: GrrMethod,
    *,
    tolerance: float | None = None,
    multiplier: float = 6.0,
    pooling_p: float = POOLING_P,
    ignore_appraiser: bool = False,
    unit: str = "",
) -> GaugeReport:
    """Repeatability and reproducibility; errors as `alignment.statistics.grr_study.grr`."""
    type3 = ignore_appraiser or without_appraiser(rows)
    offset, values = deviations([row.value for row in rows])
    data = GaugeData(
        [row.part for row in rows], values, None if type3 else [row.appraiser for row in rows], offset
    )
    found = grr(data, method, tolerance=tolerance, multiplier=multiplier, pooling_p=pooling_p)
    components = {
        "grr": found.grr,
        "repeatability": found.repeatability,
        "reproducibility": found.reproducibility,
        "appraiser": found.appraiser,
        "interaction": found.interaction,
        "part_variation": found.part_variation,
        "total_variation": found.total_variation,
    }
    seen = found.repeated_differently
    # Trials that are all alike show no repeatability; what appraisers do differently is seen all the same.
    some = seen or found.grr > 0.0
    percents = {name: _number(found.percent_study_variation(value)) for name, value in components.items()}
    figures: dict[str, float] = {
        "grr_percent_study_variation": percents["grr"] if some else math.nan,
        "ndc": math.nan if found.ndc is None else found.ndc,
        "repeatability": found.repeatability,
        "reproducibility": found.reproducibility,
        "grr": found.grr,
        "part_variation": found.part_variation,
        "total_variation": found.total_variation,
        "repeatability_percent_study_variation": percents["repeatability"] if seen else math.nan,
        "reproducibility_percent_study_variation": percents["reproducibility"],
        "part_variation_percent_study_variation": percents["part_variation"],
        "mean": found.mean,
    }
    goals = [Goal("grr_percent_study_variation", "at_most", CONDITIONAL_PERCENT)]
    percent_tolerance = found.percent_tolerance(found.grr)
    if percent_tolerance is not None:
        figures["grr_percent_tolerance"] = percent_tolerance if some else math.nan
        goals.append(Goal("grr_percent_tolerance", "at_most", CONDITIONAL_PERCENT))
    rows_out: list[Row] = [
        {
            "component": name,
            "sigma": value,
            "spread": multiplier * value,
            "percent_of_study": found.percent_study_variation(value),
            "percent_of_variance": None if math.isnan(percents[name]) else percents[name] ** 2 / 100.0,
            "percent_of_tolerance": found.percent_tolerance(value),
        }
        for name, value in components.items()
    ]
    facts = _grr_facts(found, {"unit": unit, "pooling_p": pooling_p})
    assessment = _grr_assessment(found, percent_tolerance) + _coarse(values, found.repeatability)
    text = f"{_size(found)}, by {_METHODS[method]}. {assessment}"
    plots = {
        "gauge-grr-components": pictures.grr_components(found),
        "gauge-grr-values": pictures.grr_values(data, unit),
    }
    return GaugeReport(
        "gauge-grr",
        "Repeatability and reproducibility of the gauge (AIAG MSA, 4th edition).",
        StudyResult(tuple(rows_out), figures, tuple(goals), text, plots),
        facts,
        assessment,
        no_verdict=not seen,
    )


def analyse_type1(
    rows: Sequence[GaugeRow],
    reference: float,
    tolerance: float,
    *,
    share: float = 0.2,
    spread: float = 6.0,
    resolution: float | None = None,
    unit: str = "",
) -> GaugeReport:
    """Cg and Cgk; errors as `alignment.statistics.type1_study.type1`."""
    _one_part(rows)
    offset, values = _split(rows, reference)
    found = type1(values, reference - offset, tolerance, share=share, spread=spread, resolution=resolution)
    figures = {
        "cg": _number(found.cg),
        "cgk": _number(found.cgk),
        "n": found.n,
        "mean": offset + found.mean,
        "standard_deviation": found.deviation,
        "bias": found.bias,
        "bias_p": _number(found.bias_p),
        "least_tolerance": _number(found.least_tolerance),
    }
    goals = [Goal("cg", "at_least", LEAST_CG), Goal("cgk", "at_least", LEAST_CG)]
    if found.resolution_percent is not None:
        figures["resolution_percent_tolerance"] = found.resolution_percent
        goals.append(Goal("resolution_percent_tolerance", "at_most", LARGEST_RESOLUTION_PERCENT))
    if found.cg is None or found.cgk is None:
        assessment = f"{ALL_EQUAL}: {CURE}"
    else:
        capable = all(goal.met(figures[goal.figure]) for goal in goals)
        assessment = f"Cg {found.cg:.2f}, Cgk {found.cgk:.2f}: {'capable' if capable else 'NOT capable'}"
        if found.bias_p is not None and found.bias_p < 0.05:
            assessment += f"; the bias {found.bias:+.4g} is significant"
        if found.resolution_percent is not None and found.resolution_percent > LARGEST_RESOLUTION_PERCENT:
            assessment += f"; the resolution is {found.resolution_percent:.1f} % of the tolerance"
        assessment += _coarse(values)
    if found.n < USUAL_VALUES:
        assessment += f"; {found.n} repetitions, {USUAL_VALUES} are usual"
    result = StudyResult(
        tuple({"trial": row.trial, "value": float(row.value)} for row in rows),
        figures,
        tuple(goals),
        f"{found.n} repetitions on a master of {reference:g} {unit}, tolerance {tolerance:g}. {assessment}.",
        {"gauge-type1": pictures.type1_run(values + offset, reference, share * tolerance, unit)},
    )
    facts: dict[str, Any] = {
        "reference": reference, "tolerance": tolerance, "share": share, "spread_in_sigma": spread,
        "unit": unit,
    }  # fmt: skip
    return GaugeReport(
        "gauge-type1", "Capability of the gauge on one master.", result, facts, assessment, found.cg is None
    )


def analyse_linearity(rows: Sequence[GaugeRow], *, confidence: float = 0.95, unit: str = "") -> GaugeReport:
    """Bias over the range; rows carry a reference. Errors as `linearity`."""
    values = np.array([float(row.value) for row in rows])
    references = np.array([_reference(row) for row in rows])
    found = linearity(values, references, confidence)
    figures = {
        "slope": found.slope,
        "intercept": found.intercept,
        "percent_linearity": found.percent_linearity(),
        "r_squared": _number(found.r_squared),
        "residual_standard_deviation": found.residual_deviation,
        "slope_p": _number(found.slope_p),
        "intercept_p": _number(found.intercept_p),
        "largest_bias": max((each.bias for each in found.biases), key=abs),
        "significant_biases": sum(bool(each.significant) for each in found.biases),
        "zero_outside_band": math.nan if found.acceptable is None else float(not found.acceptable),
        "masters_outside_band": found.outside_band,
        "worst_reference": found.worst_reference,
    }
    assessment = {
        True: "The line of no bias lies within the confidence band: the gauge is linear",
        False: "The line of no bias leaves the confidence band: the gauge has a bias or a linearity error",
        None: f"No repetition on a master differs from another: the resolution is too coarse: {CURE}",
    }[found.acceptable]
    if found.acceptable is False and not found.outside_band:
        assessment += f", between the masters, at {found.worst_reference:.6g} {unit}".rstrip()
    result = StudyResult(
        tuple(
            {
                "reference": each.reference, "n": each.n, "mean": each.mean, "bias": each.bias,
                "bias_low": each.low, "bias_high": each.high, "standard_deviation": each.deviation,
                "p": each.p,
            }
            for each in found.biases
        ),
        figures,
        (Goal("zero_outside_band", "at_most", 0.0),),
        f"bias = {found.intercept:.6g} + {found.slope:.6g} · reference. {assessment}.",
        {"gauge-linearity": pictures.linearity_line(found, values, references, unit)},
    )  # fmt: skip
    facts = {"confidence": confidence, "masters": len(found.biases), "n": found.n, "unit": unit}
    return GaugeReport(
        "gauge-linearity",
        "Bias of the gauge over its range (AIAG MSA, 4th edition).",
        result,
        facts,
        assessment,
        found.acceptable is None,
    )


def analyse_stability(
    rows: Sequence[GaugeRow],
    *,
    size: int = 1,
    rules: RuleSet = RuleSet.WESTERN_ELECTRIC,
    kind: ChartKind = ChartKind.XBAR_R,
    reference: float | None = None,
    unit: str = "",
) -> GaugeReport:
    """Control chart and drift of one master; errors as `alignment.statistics.stability_study.stability`."""
    _one_part(rows)
    timed = sorted(((row.utc, row) for row in rows if row.utc is not None), key=lambda pair: pair[0])
    # In the order of time where every value has one, else in that of the file.
    ordered = [row for _, row in timed] if len(timed) == len(rows) else rows
    offset, values = _split(ordered, reference)
    times = np.array([utc.timestamp() for utc, _ in timed])
    found = stability(
        values,
        times if len(times) == len(values) else None,
        size=size,
        reference=None if reference is None else reference - offset,
        kind=kind,
        rules=rules,
    )
    chart = found.chart
    figures = {
        "n": len(values),
        "mean": offset + float(values.mean()),
        "standard_deviation": found.deviation,
        "sigma_within": chart.sigma,
        "signals_location": math.nan if found.stable is None else len(chart.location.signals),
        "signals_spread": math.nan if found.stable is None else len(chart.spread.signals),
        "drift_per_day": _number(found.drift),
        "drift_p": _number(found.drift_p),
    }
    if found.bias is not None:
        figures["bias"] = found.bias.bias
    assessment = _stability_assessment(found) + _coarse(values)
    if found.drift_p is not None and found.drift_p < 0.01 and found.drift is not None:
        per_day = f"{unit} a day" if unit else "a day"
        assessment += f"; drift of {found.drift:+.3g} {per_day} (p {found.drift_p:.2g})"
    result = StudyResult(
        tuple(
            {"point": index + 1, "value": offset + float(value), "signals": _signals(chart.location, index)}
            for index, value in enumerate(chart.location.points)
        ),
        figures,
        (Goal("signals_location", "at_most", 0.0), Goal("signals_spread", "at_most", 0.0)),
        f"{count_of(len(values), 'value')}, {chart.kind} chart, "
        f"rules {rules} ({rule_source(rules)}). {assessment}.",
        {"gauge-stability": pictures.chart_picture(chart, offset, unit)},
    )
    facts: dict[str, Any] = {
        "chart": str(chart.kind),
        "rules": str(rules),
        "rules_source": rule_source(rules),
        "size": chart.size,
        "unit": unit,
    }
    return GaugeReport(
        "gauge-stability", "The same master over time.", result, facts, assessment, found.stable is None
    )


def analyse_budget(
    components: Sequence[Component], tolerance: float, coverage_factor: float = 2.0, unit: str = ""
) -> GaugeReport:
    """VDA 5 budget; errors as `alignment.statistics.budgets.budget`."""
    found: UncertaintyBudget = budget(components, tolerance, coverage_factor)
    figures = {
        "q_ms": found.q_ms if found.spread_seen else math.nan,
        "q_mp": found.q_mp if found.spread_seen else math.nan,
        "u_ms": found.u_ms,
        "u_mp": found.u_mp,
        "expanded_uncertainty": coverage_factor * found.u_mp,
        "least_tolerance_ms": found.least_tolerance_ms if found.spread_seen else math.nan,
        "least_tolerance_mp": found.least_tolerance_mp if found.spread_seen else math.nan,
    }
    assessment = (
        f"Q_MS {found.q_ms:.1f} % (limit {LIMIT_MS:g}), Q_MP {found.q_mp:.1f} % (limit {LIMIT_MP:g}): "
        f"{'capable' if found.capable else 'NOT capable'}"
        if found.spread_seen
        else "No spread was seen: every repeated reading is equal, so a share of the tolerance says nothing: "
        "give the resolution of the gauge, or record more digits"
    )
    result = StudyResult(
        tuple(
            {
                "contribution": str(line.component.kind), "u": line.component.u,
                "share_percent": line.share_percent, "counted": "yes" if line.counted else "no",
                "source": line.component.source,
            }
            for line in found.lines
        ),
        figures,
        (Goal("q_ms", "at_most", LIMIT_MS), Goal("q_mp", "at_most", LIMIT_MP)),
        f"Tolerance {tolerance:g} {unit}, k = {coverage_factor:g}. {assessment}.",
        {"gauge-budget": pictures.budget_bars(found)},
    )  # fmt: skip
    facts: dict[str, Any] = {"tolerance": tolerance, "coverage_factor": coverage_factor, "unit": unit}
    return GaugeReport(
        "gauge-budget", "Uncertainty budget (VDA 5, ISO 22514-7).", result, facts, assessment,
        not found.spread_seen,
    )  # fmt: skip


_METHODS = {GrrMethod.ANOVA: "analysis of variance", GrrMethod.RANGE: "average and range"}


def _grr_facts(found: GrrResult, given: dict[str, Any]) -> dict[str, Any]:
    """What was done, for a program; `given` is what the person chose of it and the result does not say."""
    return {
        "method": str(found.method),
        "type": 2 if found.appraisers else 3,
        "parts": found.parts,
        "appraisers": found.appraisers,
        "trials": found.trials,
        "study_variation_in_sigma": found.multiplier,
        "tolerance": found.tolerance,
        "interaction_p": found.interaction_p,
        "interaction_pooled": found.pooled,
        "anova": [
            {"source": s.name, "df": s.df, "ss": s.squares, "ms": s.mean_square, "f": s.f, "p": s.p}
            for s in found.table
        ],
        **given,
    }


def _grr_assessment(found: GrrResult, percent_tolerance: float | None) -> str:
    percent = found.percent_study_variation(found.grr)
    if percent is None:
        return f"{ALL_EQUAL}: {CURE}"
    if not found.repeated_differently:
        return (
            "No repetition of a part differs from another: the resolution is too coarse to judge the "
            f"repeatability, or repetitions were copied: {CURE}"
        )
    worst = max(percent, percent_tolerance or 0.0)
    verdict = (
        "acceptable"
        if worst <= ACCEPTABLE_PERCENT
        else "conditionally acceptable"
        if worst <= CONDITIONAL_PERCENT
        else "NOT acceptable"
    )
    of_tolerance = "" if percent_tolerance is None else f", {percent_tolerance:.1f} % of the tolerance"
    said = f"GRR is {percent:.1f} % of the study variation{of_tolerance}: {verdict}"
    if found.ndc is not None and found.ndc < LEAST_NDC:
        said += f"; {found.ndc} distinct categories, {LEAST_NDC} are asked for"
    if found.part_variation == 0.0:
        said += "; the parts differ by no more than the repetitions: choose them over the whole range"
    if found.parts < USUAL_PARTS:
        said += f"; {found.parts} parts, {USUAL_PARTS} are usual"
    return said


def _stability_assessment(found: StabilityResult) -> str:
    chart, points = found.chart, len(found.chart.location.points)
    if chart.in_control is None:
        within = (
            "Values of a subgroup are all equal, so the limits have no width"
            if found.deviation
            else ALL_EQUAL
        )
        return f"{within}: {CURE}"
    if found.stable is None:
        return f"{points} points could hardly show a signal: {LEAST_POINTS} are needed, {USUAL_POINTS} usual"
    signals = (*chart.location.signals, *chart.spread.signals)
    if signals:
        first = min(signal.index for signal in signals) * chart.size + 1
        return f"NOT stable: {len(signals)} signals, the first at value {first}"
    few = "" if points >= USUAL_POINTS else f"; {points} points, {USUAL_POINTS} are usual"
    return f"Stable: no signal{few}"


def _coarse(values: Array, deviation: float | None = None) -> str:
    step = coarse_step(values, deviation)
    if step is None:
        return ""
    return f"; values differ by {step:.3g} at least, more than their spread: the resolution is coarse"


def _size(found: GrrResult) -> str:
    trials = "different numbers of trials" if found.trials is None else f"{found.trials} trials"
    who = f"{found.appraisers} appraisers" if found.appraisers else "no appraiser (type 3)"
    return f"{found.parts} parts, {who}, {trials}"


def _one_part(rows: Sequence[GaugeRow]) -> None:
    parts = list(dict.fromkeys(row.part for row in rows))
    if len(parts) > 1:
        raise DegenerateInputError(
            field="part", expected="one master", seen=f"{len(parts)}: {', '.join(parts[:5])}"
        )


def _split(rows: Sequence[GaugeRow], reference: float | None) -> tuple[float, Array]:
    """Offset and exact deviations from it; the certified value itself where there is one."""
    if reference is None:
        return deviations([row.value for row in rows])
    exact = Decimal(repr(reference))
    return reference, np.array([float(row.value - exact) for row in rows])


def _reference(row: GaugeRow) -> float:
    if row.reference is None:
        raise DegenerateInputError(
            field="reference", expected=f"the certified value of part {row.part!r}", seen="none"
        )
    return float(row.reference)


def _signals(track: Any, index: int) -> str:
    return "; ".join(signal.text for signal in track.signals if signal.index == index)


def _number(value: float | None) -> float:
    return math.nan if value is None else value
