"""Study `correction`: correction functions for the printed errors of the non-parallel head (thesis 6.2)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.calibration import (
    Candidate,
    ErrorModel,
    choose_correction,
    fit_correction,
    left_out_errors,
    polynomial,
    standard_candidates,
)
from alignment.errors import ConfigurationError
from db.exports import in_style, signed
from station.figures import Goal, Progress, Row, Study, StudyResult

FILE = "nonparallel_errors.csv"
PLACES = (Path(), Path(__file__).resolve().parents[3] / "shared" / "seed")
"""Where the table is looked for: here, then beside the project."""
GRID_MM, FIRST_MM = 25.0, -75.0
PUBLISHED_BEFORE = {"x": (-0.33, 0.50), "y": (-0.42, 0.34), "z": (-0.95, 0.94)}
PUBLISHED_AFTER = {"x": 0.13, "y": 0.12, "z": 0.15}


def _three_pieces(points: Array) -> Array:
    """The pieces of f_y (6.31) over scaled points (N, 2), zero being the fourth of seven grid lines."""
    x, y = points.T
    left, right = (x <= 0) & (y < 0), (x > 0) & (y < 0)
    upper = y >= 0
    columns = [left, left * y, right, right * y, upper, upper * x, upper * y]
    return np.column_stack(columns).astype(np.float64)


PUBLISHED_FORMS = {
    "x": polynomial("degree 4 in x + degree 1 in y", [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (0, 1)]),
    "y": Candidate("three linear pieces", lambda _: (_three_pieces, None)),
    "z": polynomial("degree 1 in x and y", [(0, 0), (1, 0), (0, 1)]),
}


def read_errors(places: Sequence[Path] = PLACES) -> tuple[Array, Array]:
    """Points (49, 3) and errors (49, 3) of the printed table, millimetres; NaN where a number is illegible.

    Parameters
    ----------
    places
        Folders in which the table is looked for, in their order.

    Raises
    ------
    ConfigurationError
        When the table is not there, or not as it should be.
    """
    for place in places:
        file = place / FILE
        if file.is_file():
            rows = np.genfromtxt(file, delimiter=",", skip_header=1, ndmin=2)
            if rows.shape[1] != 5 or not np.isfinite(rows[:, :2]).all():
                raise ConfigurationError(
                    file=file, expected="columns x, y, ex, ey, ez", seen=f"{rows.shape[1]} columns"
                )
            return np.column_stack([GRID_MM * rows[:, :2] + FIRST_MM, np.zeros(len(rows))]), rows[:, 2:]
    raise ConfigurationError(
        file=places[0] / FILE,
        expected="the table of printed errors, with columns x, y (grid steps of 25 mm), ex, ey, ez (mm)",
        seen="no such file",
        cure="Put it into the current folder.",
    )


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; it draws nothing at random. See `RunStudy`."""
    del seed
    return run_table(PLACES, quick, progress)


def run_table(places: Sequence[Path], quick: bool, progress: Progress) -> StudyResult:
    """Run the study with the table that one of these folders holds.

    Raises
    ------
    ConfigurationError
        When the table is not there, or not as it should be.
    """
    points, errors = read_errors(places)
    progress(0.1, "fitting")
    correction = fit_correction(points, errors)
    rows: list[Row] = []
    figures: dict[str, float] = {}
    for column, (axis, published) in enumerate(PUBLISHED_AFTER.items()):
        known = np.isfinite(errors[:, column])
        scaled, values = correction.scaled(points)[known], errors[known, column]
        chosen = correction.models[column]
        form = choose_correction(scaled, values, [PUBLISHED_FORMS[axis]])
        progress(0.2 + 0.25 * column, f"{axis}: leaving out points")
        folds = 12 if quick else len(values)
        nested = left_out_errors(scaled, values, standard_candidates(scaled.shape[1]), folds)
        rows += [
            _row(axis, "before correction", values, None),
            {
                **_row(axis, "published correction", np.array([-published, published]), None),
                "rms_mm": None,
            },
            _row(axis, f"published form, fitted: {form.name}", form.residuals, form),
            _row(axis, f"chosen: {chosen.name}", chosen.residuals, chosen),
            _row(axis, "chosen, points left out of fit and choice", nested, None),
        ]
        figures[f"{axis}_largest_before_mm"] = float(np.abs(values).max())
        figures[f"{axis}_largest_mm"] = float(np.abs(chosen.residuals).max())
        figures[f"{axis}_left_out_rms_mm"] = float(np.sqrt(np.square(nested).mean()))
        figures[f"{axis}_left_out_largest_mm"] = float(np.abs(nested).max())
    goals = tuple(Goal(f"{axis}_largest_mm", "at_most", limit) for axis, limit in PUBLISHED_AFTER.items())
    before = ", ".join(f"{axis} {a:+.2f} to {b:+.2f}" for axis, (a, b) in PUBLISHED_BEFORE.items())
    after = ", ".join(f"{axis} ±{limit:.2f}" for axis, limit in PUBLISHED_AFTER.items())
    found = ", ".join(f"{axis} ±{figures[f'{axis}_largest_mm']:.3f}" for axis in PUBLISHED_AFTER)
    illegible = int(np.isnan(errors).sum())
    text = f"""
Errors of {len(points)} points in a plane; {illegible} numbers are illegible in print and left out.
Published, mm: {before} before, {after} after correction.
Found after correction: {found}.

Per coordinate, the form of the model is the simplest whose errors at left-out points are, within one standard
error of the difference, as small as those of the best. The left-out figures come from points that took part
neither in the fit nor in that choice: what a new point in the same field may expect.
"""
    return StudyResult(
        tuple(rows), figures, goals, text, {"correction": _plot(points, errors, correction.models)}
    )


def _row(axis: str, what: str, values: Array, model: ErrorModel | None) -> dict[str, str | float | None]:
    return {
        "coordinate": axis,
        "what": what,
        "degrees_of_freedom": None if model is None else round(model.degrees_of_freedom, 2),
        "least_mm": float(values.min()),
        "largest_mm": float(values.max()),
        "rms_mm": float(np.sqrt(np.square(values).mean())),
        "left_out_rms_mm": None if model is None else model.left_out_rms,
    }


@in_style
def _plot(points: Array, errors: Array, models: tuple[ErrorModel, ...]) -> Figure:
    figure = Figure(figsize=(10, 6.2), layout="constrained")
    axes: list[list[Axes]] = [list(row) for row in figure.subplots(2, 3, sharex=True, sharey=True)]
    for column, model in enumerate(models):
        known = np.isfinite(errors[:, column])
        limit = float(np.abs(errors[known, column]).max())
        for line, values in enumerate((errors[known, column], model.residuals)):
            at = axes[line][column]
            image = at.scatter(
                points[known, 0],
                points[known, 1],
                c=values,
                s=260,
                marker="s",
                cmap="RdBu",
                vmin=-limit,
                vmax=limit,
            )
            state = "before" if line == 0 else f"after:\n{model.name}"
            at.set_title(
                f"{'xyz'[column]} {state}\n{signed(values.min(), 3)} to {signed(values.max(), 3)} mm"
            )
            at.set_aspect("equal")
        figure.colorbar(image, ax=[row[column] for row in axes], label="mm")
    for at in axes[1]:
        at.set_xlabel("x, mm")
    for row in axes:
        row[0].set_ylabel("y, mm")
    return figure


STUDY = Study(
    "correction", "Correction functions for the printed errors of the non-parallel head (thesis 6.2).", run
)
