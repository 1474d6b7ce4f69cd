"""Study `efficiency`: how near does the robust fit come to the least scatter that its points allow?

The points of a rendered wheel, where its lines really fall and with the standard deviations that its images
really state, are laid on the surface that was fitted to them. Then they get noise of just that size along
their rays, again and again, and the robust fit must find the axis. It pays for its robustness with points
that it need not have doubted; the Cramér–Rao bound of the same points says how much.
"""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from alignment.arrays import Array, Index
from alignment.imaging import LightLines, extract_many
from alignment.stereo import StereoGeometry, epipolar_directions, match_heads
from alignment.units import ARCMIN
from alignment.values import MeasureSettings
from alignment.wheel import RevolutionFit, fit_revolution, least_covariance
from db.exports import REFERENCE, in_style, legend_outside
from sensors.simulation import draw_pose, draw_scene
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.wheels import exposed, lights, study_rig

REPEATS, QUICK_REPEATS = 400, 60
_LIMIT = 1.25
_STRETCH = 25
_GATE = 0.1  # mm; candidates of the sidewall, for the points to be those of a wheel


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    count = QUICK_REPEATS if quick else REPEATS
    rng = np.random.default_rng([seed, 7])
    progress(0.0, "picture")
    points, sigma, rays, spread, line, surface = _wheel_points(seed, rng)
    cluster = line * 65536 + np.arange(len(line)) // _STRETCH
    cluster = np.unique(cluster, return_inverse=True)[1].astype(np.int64)
    bound = np.sqrt(np.diag(least_covariance(points, sigma, rays, surface)))
    tilts, stated = np.empty((count, 2)), np.empty((count, 2))
    for k in range(count):
        progress(k / count, f"repeat {k + 1} of {count}")
        moved = points + (sigma * rng.standard_normal(len(sigma)))[:, None] * rays
        fit = fit_revolution(
            moved, sigma, rays, cluster, surface.normal, surface.centre, line=line, spread=spread
        )
        tilts[k] = surface.tilt_axes @ fit.normal
        stated[k] = np.sqrt(np.diag(fit.covariance))
    scatter = tilts.std(axis=0, ddof=1)
    ratios = scatter / bound
    figures = {
        "largest_ratio_to_cramer_rao": float(ratios.max()),
        "scatter_arcmin": float(scatter.max() / ARCMIN),
        "cramer_rao_arcmin": float(bound.max() / ARCMIN),
        "stated_over_scatter": float(np.sqrt(np.square(stated).mean(axis=0) / scatter**2).mean()),
        "points": float(len(points)),
    }
    rows: list[Row] = [
        {
            "tilt": name,
            "scatter_arcmin": float(s / ARCMIN),
            "cramer_rao_arcmin": float(b / ARCMIN),
            "ratio": float(s / b),
            "stated_arcmin": float(math.sqrt(np.square(u).mean()) / ARCMIN),
        }
        for name, s, b, u in zip(("e1", "e2"), scatter, bound, stated.T, strict=True)
    ]
    # The ratio of a scatter from few repeats is uncertain by 1/√(2 n); the quick form allows twice that.
    slack = 2.0 / math.sqrt(2.0 * count) if quick else 0.0
    goals = (Goal("largest_ratio_to_cramer_rao", "at_most", _LIMIT + slack),)
    text = f"""
{count} draws of noise on {len(points)} points of three heads: the axis scatters by
{scatter.max() / ARCMIN:.4f}′, {ratios.max():.2f} times the Cramér–Rao bound of the same points.
"""
    return StudyResult(tuple(rows), figures, goals, text, {"efficiency": _plot(tilts, bound)})


def _wheel_points(
    seed: int, rng: np.random.Generator
) -> tuple[Array, Array, Array, Array, Index, RevolutionFit]:
    """Points, deviations, rays, spreads, lines of a rendered wheel, laid on the surface that fits them."""
    rig = study_rig("standard", seed)
    scene = draw_scene(rig.spec, rig.side, draw_pose(rng, 0.01, -0.005), rng, seed=seed)
    pictures = exposed(lights(scene, rig.true), scene, rng)
    found = extract_many([i for p in pictures for i in (p.left, p.right)], epipolar_directions(rig.true))
    lines: list[LightLines] = [each for each in found if each is not None]
    pairs = list(zip(lines[::2], lines[1::2], strict=True))
    matched = match_heads(pairs, StereoGeometry.of(rig.true.heads), MeasureSettings().depth_range_mm)
    first = np.cumsum([0, *(int(c.left_line.max()) + 1 for c in matched)])
    points = np.concatenate([c.points for c in matched])
    sigma = np.concatenate([c.sigma for c in matched])
    rays = np.concatenate([c.rays for c in matched])
    spread = np.concatenate([c.spread for c in matched])
    line = np.concatenate([c.left_line + k for c, k in zip(matched, first, strict=False)])
    near = np.abs(points[:, 2] - np.median(points[:, 2])) < 40.0
    fit = fit_revolution(
        points[near],
        sigma[near],
        rays[near],
        line[near],
        np.array([0.0, 0.0, 1.0]),
        np.zeros(3),
        line=line[near],
        spread=spread[near],
    )
    on = np.abs(np.nan_to_num(fit.height(points), nan=np.inf)) < _GATE
    points, sigma, rays, spread, line = points[on], sigma[on], rays[on], spread[on], line[on]
    for _ in range(5):
        # Along its ray each point goes to the surface.
        rate = (fit.height(points + 1e-3 * rays) - fit.height(points)) / 1e-3
        points = points - (fit.height(points) / rate)[:, None] * rays
    inside = np.isfinite(points).all(axis=1)
    return points[inside], sigma[inside], rays[inside], spread[inside], line[inside], fit


@in_style
def _plot(tilts: Array, bound: Array) -> Figure:
    figure = Figure(figsize=(5, 4.4), layout="constrained")
    axes = figure.subplots()
    axes.plot(*(tilts / ARCMIN).T, ".", ms=3, label="fits")
    turn = np.linspace(0.0, 2.0 * math.pi, 100)
    axes.plot(
        2 * bound[0] / ARCMIN * np.cos(turn),
        2 * bound[1] / ARCMIN * np.sin(turn),
        color=REFERENCE,
        label="2 σ, bound",
    )
    axes.set_xlabel("tilt e1, arcmin")
    axes.set_ylabel("tilt e2, arcmin")
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
    legend_outside(figure)
    return figure


STUDY = Study("efficiency", "Scatter of the fitted axis beside the least that its points allow.", run)
