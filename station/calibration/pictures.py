"""Pictures of a calibration: residuals, coverage, predicted uncertainty, corrections of the plate."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from alignment.arrays import Array
from alignment.calibration import Adjustment, NominalWheel, point_covariance
from alignment.values import HeadCalibration, RigCalibration
from db.exports import BAD, REFERENCE, SERIES, in_style, legend_outside

DEPTHS_MM = (-30.0, 0.0, 30.0)
"""Heights over the rig's plane at which the measuring volume is mapped, millimetres."""
_ACROSS = 40  # map points over the width of an image
_ARROW = 0.06  # length of a typical arrow over the width of its picture
_DPI = 110


@in_style
def residual_vectors(adjustment: Adjustment) -> Figure:
    """Residual vectors of every camera over its image, magnified; observations without weight in red."""
    figure, axes = _per_camera(adjustment)
    strong = adjustment.weights >= 0.5
    typical = (
        float(np.sqrt(np.square(adjustment.residuals[strong]).sum(axis=1).mean())) if strong.any() else 0
    )
    for k, (key, ax) in enumerate(zip(adjustment.data.cameras, axes, strict=True)):
        width, _ = adjustment.data.sizes[key]
        magnified = _round_down(_ARROW * width / max(typical, 1e-9))
        for rows, colour in ((strong, SERIES[0]), (~strong, BAD)):
            mine = rows & (adjustment.camera == k)
            _arrows(ax, adjustment.pixels[mine], adjustment.residuals[mine] * magnified, colour)
        mine = strong & (adjustment.camera == k)
        rms = float(np.sqrt(np.square(adjustment.residuals[mine]).sum(axis=1).mean())) if mine.any() else 0.0
        ax.set_title(f"{' '.join(key)}: {rms:.4f} px RMS, arrows × {magnified:g}")
    return figure


@in_style
def image_coverage(adjustment: Adjustment) -> Figure:
    """Where the marks of each view lie in each image."""
    figure, axes = _per_camera(adjustment)
    for k, (key, ax) in enumerate(zip(adjustment.data.cameras, axes, strict=True)):
        for v, view in enumerate(adjustment.data.views):
            x, y = adjustment.pixels[(adjustment.camera == k) & (adjustment.view == v)].T
            ax.plot(x, y, ".", markersize=3, color=SERIES[v % len(SERIES)], label=view.name)
        ax.set_title(f"{' '.join(key)}: {int((adjustment.camera == k).sum())} marks")
    legend_outside(figure, columns=1, where="outside right upper")
    return figure


@in_style
def volume_coverage(adjustment: Adjustment, wheel: NominalWheel) -> Figure:
    """Where the marks lie in the rig frame, from the front and from the side, with the nominal wheel."""
    figure = Figure(figsize=(10, 5), layout="constrained", dpi=_DPI)
    front, side = figure.subplots(1, 2)
    for v, pose in enumerate(adjustment.rig_from_plate):
        rows = np.unique(adjustment.mark[adjustment.view == v])
        x, y, z = pose.apply(adjustment.data.plate.points[rows]).T
        front.plot(
            x, y, ".", markersize=2, color=SERIES[v % len(SERIES)], label=adjustment.data.views[v].name
        )
        side.plot(z, y, ".", markersize=2, color=SERIES[v % len(SERIES)])
    _draw_wheel(front, wheel)
    for sign in (-1.0, 1.0):
        radius = np.linspace(wheel.inner_mm, wheel.outer_mm)
        side.plot(wheel.height(radius), sign * radius, color=REFERENCE, linewidth=1)
    front.set(title="from outboard", xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    side.set(title="from the side", xlabel="z, outboard [mm]", ylabel="y [mm]")
    legend_outside(figure, columns=1, where="outside right upper")
    return figure


@in_style
def uncertainty_map(calibration: RigCalibration, wheel: NominalWheel) -> Figure:
    """Standard uncertainty along z of measured points over the measuring volume, from the calibration alone.

    One picture for each of `DEPTHS_MM`, micrometres, where both cameras of a head see.
    """
    figure = Figure(figsize=(12, 4.4), layout="constrained", dpi=_DPI)
    row = figure.subplots(1, len(DEPTHS_MM), sharex=True, sharey=True)
    maps = [
        [(seen := _common_points(head, z), _sigma_um(calibration, k, seen)) for z in DEPTHS_MM]
        for k, head in enumerate(calibration.heads)
    ]
    every = np.concatenate([values for levels in maps for _, values in levels])
    low, high = (float(every.min()), float(np.percentile(every, 99))) if len(every) else (0.0, 1.0)
    for number, (z, ax) in enumerate(zip(DEPTHS_MM, row, strict=True)):
        for levels in maps:
            points, values = levels[number]
            painted = ax.scatter(
                points[:, 0], points[:, 1], c=values, s=6, marker="s", cmap="viridis", vmin=low, vmax=high
            )
        _draw_wheel(ax, wheel)
        ax.set(title=f"z = {z:g} mm", xlabel="x [mm]", aspect="equal")
    row[0].set_ylabel("y [mm]")
    figure.colorbar(painted, ax=row, label="standard uncertainty along z [µm]")
    return figure


@in_style
def mark_corrections(adjustment: Adjustment) -> Figure:
    """How far the adjustment moved each seen mark of the plate: arrows in the plate, colour for height."""
    figure = Figure(figsize=(7, 6), layout="constrained", dpi=_DPI)
    ax = figure.subplots()
    rows = np.unique(adjustment.mark)
    points, moved = adjustment.data.plate.points[rows], adjustment.mark_correction_mm[rows]
    width = float(np.ptp(points[:, 0])) or 1.0
    magnified = _round_down(0.5 * _ARROW * width / max(float(np.sqrt(np.square(moved[:, :2]).mean())), 1e-9))
    _arrows(ax, points[:, :2], moved[:, :2] * magnified, REFERENCE)
    painted = ax.scatter(points[:, 0], points[:, 1], c=1000.0 * moved[:, 2], s=10, cmap="coolwarm")
    figure.colorbar(painted, label="height [µm]")
    ax.set(title=f"arrows × {magnified:g}", xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    return figure


def _per_camera(adjustment: Adjustment) -> tuple[Figure, list[Axes]]:
    keys = adjustment.data.cameras
    columns = min(2, len(keys))
    lines = math.ceil(len(keys) / columns)
    figure = Figure(figsize=(5 * columns + 1.5, 3.8 * lines), layout="constrained", dpi=_DPI)
    axes = list(figure.subplots(lines, columns, squeeze=False).ravel())
    for spare in axes[len(keys) :]:
        spare.set_axis_off()
    for key, ax in zip(keys, axes, strict=False):
        width, height = adjustment.data.sizes[key]
        ax.set(xlim=(0, width - 1), ylim=(height - 1, 0), aspect="equal")
        ax.set_xlabel("u [px]")
        ax.set_ylabel("v [px]")
    return figure, axes[: len(keys)]


def _arrows(ax: Axes, at: Array, arrows: Array, colour: str) -> None:
    if len(at):
        ax.quiver(*at.T, *arrows.T, angles="xy", scale_units="xy", scale=1.0, width=0.002, color=colour)


def _round_down(value: float) -> float:
    """1, 2 or 5 times a power of ten: a magnification that a person can divide by."""
    power = 10.0 ** math.floor(math.log10(max(value, 1e-12)))
    return power * max(step for step in (1, 2, 5) if step <= value / power + 1e-9)


def _draw_wheel(ax: Axes, wheel: NominalWheel) -> None:
    for radius in (wheel.inner_mm, wheel.outer_mm):
        ax.add_patch(Circle((0.0, 0.0), radius, fill=False, color=REFERENCE, linewidth=1))
    margin = 1.1 * wheel.outer_mm
    ax.set(xlim=(-margin, margin), ylim=(-margin, margin))


def _common_points(head: HeadCalibration, z: float) -> Array:
    """(N, 3) points at a height that both cameras of a head see, even over the left image."""
    left = head.left.model
    step = (left.width - 1) / (_ACROSS - 1)
    u, v = np.meshgrid(np.arange(0, left.width, step), np.arange(0, left.height, step))
    rays = head.left.rays(np.column_stack([u.ravel(), v.ravel()]))
    origin = head.left.rig_from_camera.translation
    reach = (z - origin[2]) / np.where(np.abs(rays[:, 2]) > 1e-6, rays[:, 2], np.nan)
    points = (origin + reach[:, None] * rays)[reach > 0]
    ahead = head.right.rig_from_camera.inverse().apply(points)[:, 2] > 1.0
    points = points[ahead]
    pixels = head.right.project(points)
    inside = ((pixels >= 0) & (pixels <= [head.right.model.width - 1, head.right.model.height - 1])).all(
        axis=1
    )
    out: Array = points[inside]
    return out


def _sigma_um(calibration: RigCalibration, head: int, points: Array) -> Array:
    if not len(points):
        return np.zeros(0)
    variance = point_covariance(calibration, head, points)[:, 2, 2]
    out: Array = 1000.0 * np.sqrt(np.maximum(variance, 0.0))
    return out
