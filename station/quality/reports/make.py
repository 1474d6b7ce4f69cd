"""Reports by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from alignment.errors import ConfigurationError
from alignment.statistics import ChartKind, RuleSet
from db.queries import Characteristic, Filter, ResultReader
from station.quality.reports.adjusting import adjusting_sections
from station.quality.reports.choices import TITLES, ReportKind, SplitBy
from station.quality.reports.compare import compare_sections, drift_section
from station.quality.reports.counts import pareto_section, yield_section
from station.quality.reports.repairs import came_back, repair_sections
from station.quality.reports.report import Report, Section, in_words
from station.quality.reports.trace import since_check_sections, vin_sections
from station.quality.reports.units import by_unit
from station.quality.reports.values import capability_section, chart_sections


@dataclass(frozen=True)
class ReportOptions:
    """What a report is asked beside its filter.

    Attributes
    ----------
    characteristics
        Angles and lengths; none means all that have values.
    chart, rules, size
        Kind of control charts, which signals count, values per subgroup.
    split
        Capability for each station or day by itself.
    limits_from, limits_until
        Period in which the process was good: charts take their limits from it, and from their own values
        without.

    Raises
    ------
    ConfigurationError
        When only one of both is given.
    """

    characteristics: Sequence[Characteristic] = ()
    chart: ChartKind = ChartKind.INDIVIDUALS
    rules: RuleSet = RuleSet.THREE_SIGMA
    size: int = 5
    split: SplitBy = SplitBy.NOTHING
    limits_from: datetime | None = None
    limits_until: datetime | None = None

    def __post_init__(self) -> None:
        if (self.limits_from is None) != (self.limits_until is None):
            raise ConfigurationError(
                choice="limits from, limits until", expected="both ends of the period", seen="only one"
            )


def make_report(
    reader: ResultReader, kind: ReportKind, where: Filter, options: ReportOptions, made_utc: datetime
) -> Report:
    """Ask the database.

    Raises
    ------
    InputError
        When a VIN is needed and missing, or unknown.
    StoreError
        When the database fails.
    """
    sections = _sections(reader, kind, where, options)
    return Report(kind, TITLES[kind], in_words(where), reader.where, made_utc, sections)


def require_ending(path: Path) -> None:
    """Refuse a file that no report is written as.

    Raises
    ------
    ConfigurationError
        Names the endings.
    """
    if path.suffix.lower() not in (".html", ".pdf"):
        raise ConfigurationError(choice="out", expected="a name that ends in .html or .pdf", seen=path.name)


def write_report(path: Path, report: Report) -> None:
    """Write a report as ``.html`` or ``.pdf``.

    Raises
    ------
    ConfigurationError
        For another ending.
    OSError
        When the file cannot be written.
    """
    require_ending(path)
    if path.suffix.lower() == ".html":
        from station.quality.reports.html import write_html

        write_html(path, report)
    else:
        from station.quality.reports.pdf import write_pdf

        write_pdf(path, report)


def _sections(reader: ResultReader, kind: ReportKind, where: Filter, options: ReportOptions) -> list[Section]:
    asked = options.characteristics
    match kind:
        case ReportKind.YIELD:
            return [yield_section(reader, where)]
        case ReportKind.PARETO:
            return [pareto_section(reader, where)]
        case ReportKind.CAPABILITY:
            return by_unit(
                asked, lambda unit: [capability_section(reader, where, asked, options.split, unit)]
            )
        case ReportKind.CHART:
            baseline = None
            if options.limits_from is not None:
                baseline = replace(where, from_utc=options.limits_from, until_utc=options.limits_until)
            chart = options.chart, options.rules, options.size, baseline
            return by_unit(asked, lambda unit: chart_sections(reader, where, asked, *chart, unit=unit))
        case ReportKind.COMPARE:
            return by_unit(asked, lambda unit: compare_sections(reader, where, asked, unit))
        case ReportKind.DRIFT:
            return [drift_section(reader, where, asked)]
        case ReportKind.ADJUSTING:
            return adjusting_sections(reader, where)
        case ReportKind.REPAIRS:
            return repair_sections(reader, where)
        case ReportKind.SINCE_CHECK:
            return since_check_sections(reader, where)
        case ReportKind.VIN:
            if where.vin is None:
                raise ConfigurationError(choice="vin", expected="the VIN of a vehicle", seen="none")
            return vin_sections(reader, where.vin)
        case ReportKind.ALL:
            return [
                section
                for each in ReportKind
                if each not in (ReportKind.ALL, ReportKind.VIN)
                for section in _worth_telling(each, _sections(reader, each, where, options))
            ]


def _worth_telling(kind: ReportKind, sections: list[Section]) -> list[Section]:
    """What a report of everything says of one kind: few vehicles are adjusted, in doubt, or come back."""
    if kind is ReportKind.ADJUSTING:
        return [section for section in sections if section.rows]
    if kind is ReportKind.SINCE_CHECK:
        return [section for section in sections if section.rows or section.name != "doubted"]
    if kind is ReportKind.REPAIRS and not came_back(sections):
        return []
    return sections
