"""Report of a calibration: one HTML file that holds its pictures and needs nothing else."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from alignment.calibration import Adjustment, GateJudgement, NominalWheel
from alignment.units import ARCMIN
from alignment.values import Side, nominal_vehicle_from_rig
from db.exports import MINUS, signed
from sensors.formats import write_bytes
from station.calibration.pictures import (
    image_coverage,
    mark_corrections,
    residual_vectors,
    uncertainty_map,
    volume_coverage,
)
from station.pages import page

REPORT_FILE = "report.html"


@dataclass(frozen=True)
class Table:
    """Texts of a table, by rows."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]


def write_calibration_report(
    folder: Path,
    adjustment: Adjustment,
    judgement: GateJudgement,
    *,
    identity: str,
    rig: str,
    side: Side,
    method: str,
    created_utc: datetime,
    wheel: NominalWheel | None = None,
) -> Path:
    """Write ``report.html`` with verdict, tables and pictures; return its path.

    Parameters
    ----------
    folder
        Made when it is missing; a report of the same name in it is replaced.
    adjustment, judgement
        How the calibration was found, or would have been, and what the gate said.
    identity
        Of the calibration; for a refused one, a word that says so.
    rig, side
        Name of the rig, side of the vehicle.
    method
        How it was made, in words.
    created_utc
        When it was made; aware.
    wheel
        The tyre drawn into the pictures; None for the nominal one.

    Raises
    ------
    FormatError
        When the folder cannot be made or written.
    DegenerateInputError
        When a head lacks one of its cameras.
    """
    wheel = wheel or NominalWheel()
    calibration = adjustment.rig_calibration(identity, rig, side, nominal_vehicle_from_rig(side))
    pictures = (
        ("Residuals", "Projected less observed marks.", residual_vectors(adjustment)),
        ("Coverage of the images", "Marks of all views.", image_coverage(adjustment)),
        (
            "Coverage of the measuring volume",
            "Marks in the rig frame; circles and lines are the nominal tyre.",
            volume_coverage(adjustment, wheel),
        ),
        (
            "Predicted uncertainty",
            "Of points measured by one head, from the calibration alone. It is common to all points nearby "
            "and does not average out.",
            uncertainty_map(calibration, wheel),
        ),
        (
            "Corrections of the plate",
            "Found less stated positions of its marks.",
            mark_corrections(adjustment),
        ),
    )
    text = page(
        __package__,
        "calibration.html",
        title=f"Calibration {identity}",
        rig=rig,
        side=side,
        created=f"{created_utc.astimezone(UTC):%Y-%m-%d %H:%M:%S}",
        method=method,
        model=adjustment.model,
        verdict="accepted" if judgement else "refused",
        reason=judgement.reason,
        warnings=judgement.warnings,
        figures=_figures(judgement, adjustment),
        cameras=_camera_table(adjustment, judgement),
        parameters=_parameter_table(adjustment),
        stage=_stage_table(adjustment),
        pictures=[
            {"title": title, "caption": caption, "data": _png(figure)} for title, caption, figure in pictures
        ],
    )
    path = folder / REPORT_FILE
    write_bytes(path, text.encode("utf-8"))
    return path


def _figures(judgement: GateJudgement, adjustment: Adjustment) -> str:
    views, marks = len(adjustment.data.views), len(np.unique(adjustment.mark))
    return (
        f"{views} views, {marks} marks, {len(adjustment.camera)} observations, residual "
        f"{adjustment.rms_px:.4f} px RMS, condition {adjustment.condition:.1e}, {adjustment.iterations} steps"
        f"{_angles(judgement)}"
    )


def _angles(judgement: GateJudgement) -> str:
    if judgement.camber_u95 is None or judgement.toe_u95 is None:
        return ""
    camber, toe = judgement.camber_u95 / ARCMIN, judgement.toe_u95 / ARCMIN
    return f"; predicted U95 of camber {camber:.3f}′, of toe {toe:.3f}′"


def _camera_table(adjustment: Adjustment, judgement: GateJudgement) -> Table:
    rows = [
        (
            figures.name,
            str(figures.views),
            str(figures.marks),
            f"{100 * figures.image_share:.0f} %",
            f"{100 * figures.depth_share:.1f} %",
            f"{figures.noise_scale:.2f}",
            f"{100 * figures.outliers:.1f} %",
            signed(figures.structure, 2),
            "" if figures.blur_px is None else f"{figures.blur_px:.2f} px",
            "" if figures.contrast is None else f"{figures.contrast:.0f}",
            f"{adjustment.redundancy[figures.camera]:.0f}",
        )
        for figures in judgement.cameras
    ]
    head = (
        "camera", "views", "marks", "image covered", "depth range", "noise over stated", "without weight",
        "correlation", "blur", "contrast over noise", "redundancy",
    )  # fmt: skip
    return Table(head, rows)


def _parameter_table(adjustment: Adjustment) -> Table:
    """Poses and lenses with their standard uncertainties."""
    deviations = np.sqrt(np.maximum(np.diag(adjustment.covariance), 0.0))
    rows, first = [], 0
    names: tuple[str, ...] = ()
    for key in adjustment.data.cameras:
        camera = adjustment.cameras[key]
        names = camera.model.parameter_names
        values = np.concatenate([camera.rig_from_camera.translation, camera.model.parameters])
        size = 6 + len(names)
        sigma = deviations[first : first + size]
        first += size
        turn = (f"{value:.2f}" for value in sigma[:3] / ARCMIN)
        rows.append(
            (" ".join(key), *turn, *(_with_sigma(v, s) for v, s in zip(values, sigma[3:], strict=True)))
        )
    head = (
        "camera", "u(rx) [′]", "u(ry) [′]", "u(rz) [′]", "x [mm]", "y [mm]", "z [mm]", *names,
    )  # fmt: skip
    # A parameter is a line: there are more of them than cameras, and a page is higher than wide.
    turned = list(zip(head, *rows, strict=True))
    return Table(turned[0], turned[1:])


def _with_sigma(value: float, sigma: float) -> str:
    """The value with as many digits as its uncertainty has meaning."""
    if sigma <= 0.0:
        return f"{value:g}".replace("-", MINUS)
    digits = min(max(0, 1 - math.floor(math.log10(sigma))), 9)
    return f"{value:.{digits}f} ± {sigma:.{digits}f}".replace("-", MINUS)


def _stage_table(adjustment: Adjustment) -> Table:
    rows: list[Sequence[str]] = []
    for view, moved in zip(adjustment.data.views, adjustment.stage_correction_mm, strict=True):
        if view.stage_mm is None:
            rows.append((view.name, "held by hand", "", "", "", "", ""))
        else:
            stage, correction = view.stage_mm, 1000.0 * moved
            rows.append(
                (
                    view.name,
                    *(f"{v:.3f}".replace("-", MINUS) for v in stage),
                    *(signed(v, 1) for v in correction),
                )
            )
    head = ("view", "x [mm]", "y [mm]", "z [mm]", "Δx [µm]", "Δy [µm]", "Δz [µm]")
    return Table(head, rows)


def _png(figure: Figure) -> str:
    """A picture as it stands in the address of an image."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return base64.b64encode(buffer.getvalue()).decode("ascii")
