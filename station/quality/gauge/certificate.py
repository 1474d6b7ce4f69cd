"""PDF certificate of one gauge study: figures against their limits, pictures, raw values."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from alignment.errors import InputError
from alignment.statistics import GrrMethod
from db.exports import Document
from db.records import StoredGaugeStudy, StudyKind
from station.quality.cells import heading, on_paper
from station.quality.gauge.analysis import (
    GaugeReport,
    analyse_grr,
    analyse_linearity,
    analyse_stability,
    analyse_type1,
)
from station.quality.gauge.source import GaugeSource, source_of

_LONGEST_RAW = 1000


def analyse_stored(stored: StoredGaugeStudy, source: GaugeSource) -> GaugeReport:
    """Analyse a stored study as its plan says, with the usual settings.

    Raises
    ------
    InputError
        When values are missing, or the plan lacks a number that the study needs.
    """
    tolerance, reference = source.number("tolerance", None), source.number("reference", None)
    with source.named_in_errors():
        match stored.record.kind:
            case StudyKind.GRR:
                return analyse_grr(source.rows, GrrMethod.ANOVA, tolerance=tolerance, unit=source.unit)
            case StudyKind.LINEARITY:
                return analyse_linearity(source.rows, unit=source.unit)
            case StudyKind.STABILITY:
                return analyse_stability(source.rows, reference=reference, unit=source.unit)
            case StudyKind.TYPE1:
                if tolerance is None or reference is None:
                    raise InputError(
                        choice="study", expected="a study with reference and tolerance",
                        seen="one without", cure="Give both when the study is planned or stored",
                    )  # fmt: skip
                return analyse_type1(source.rows, reference, tolerance, unit=source.unit)


def write_study_certificate(path: Path, stored: StoredGaugeStudy, *, created: datetime) -> GaugeReport:
    """Write the certificate of a study; return what stands on it.

    Errors as `analyse_stored`, and OSError when the file cannot be written.
    """
    source = source_of(stored)
    report = analyse_stored(stored, source)
    record = stored.record
    made = f"{created.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"
    document = Document(f"Gauge study {record.name}", f"study {record.uuid}    made {made}", created)
    facts = [
        ("Study", f"{report.summary}"),
        ("Result", report.assessment),
        ("Characteristic", f"{record.characteristic}{f', in {source.unit}' if source.unit else ''}"),
        ("Planned", f"{record.created_utc.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"),
        ("Values", f"{len(stored.values)}, of which corrected {len(stored.all_values) - len(stored.values)}"),
        ("Comment", record.comment),
    ]
    document.facts([pair for pair in facts if pair[1]])
    document.heading("Figures")
    result = report.result
    document.rows(
        ("figure", "value", "limit", "met"),
        [
            (
                heading(name),
                on_paper(name, value),
                ", ".join(str(goal) for goal in result.goals if goal.figure == name),
                ", ".join(goal.said(value, "yes", "NO") for goal in result.goals if goal.figure == name),
            )
            for name, value in result.figures.items()
        ],
    )
    document.paragraph(result.text)
    for figure in result.plots.values():
        document.picture(figure)
    anova = report.facts.get("anova")
    if anova:
        document.heading("Analysis of variance")
        document.rows(
            ("source", "df", "sum of squares", "mean square", "F", "p"),
            [
                (
                    line["source"], str(line["df"]), f"{line['ss']:.6g}", f"{line['ms']:.6g}",
                    "" if line["f"] is None else f"{line['f']:.3f}",
                    "" if line["p"] is None else f"{line['p']:.3g}",
                )
                for line in anova
            ],
        )  # fmt: skip
    cycles = {(value.part, value.appraiser, value.trial): value.cycle for value in stored.values}
    # As many decimals as the value with the most of them: so they stand below each other.
    texts = [f"{float(row.value):.6g}" for row in source.rows]
    decimals = max((len(text.partition(".")[2]) for text in texts if "e" not in text), default=6)
    document.heading("Raw values")
    document.rows(
        ("part", "appraiser", "trial", "value", "time (UTC)", "cycle"),
        [
            (
                row.part, row.appraiser, str(row.trial), f"{float(row.value):.{decimals}f}",
                "" if row.utc is None else f"{row.utc.astimezone(UTC):%Y-%m-%d %H:%M:%S}",
                str(cycles[row.part, row.appraiser, row.trial] or ""),
            )
            for row in source.rows[:_LONGEST_RAW]
        ],
    )  # fmt: skip
    if len(source.rows) > _LONGEST_RAW:
        document.paragraph(f"The first {_LONGEST_RAW} of {len(source.rows)} values; the database holds all.")
    document.save(path)
    return report
