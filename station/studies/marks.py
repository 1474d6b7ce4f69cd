"""Study `marks`: bias and noise of every way to locate a mark, over radius, tilt, contrast, blur and noise.

Marks are rendered exactly (`station.studies.rendered_marks`), a dozen to an image, at random places between
the pixels, in uneven light. Every method gets the same images and, if it needs one, the same rough search;
OpenCV and scikit-image search for themselves. The Cramér–Rao bound is that of an image whose every pixel is
used and of which nothing is known but that it shows a blurred ellipse in evenly changing light.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.imaging import (
    OPERATORS,
    THRESHOLDS,
    RoughMarks,
    find_marks,
    fit_grid_homography,
    homography_offsets,
    locate_marks,
)
from alignment.values import Image
from db.exports import BAD, REFERENCE, in_style, legend_outside
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.mark_peers import PEERS
from station.studies.rendered_marks import (
    RenderedMark,
    as_camera,
    imaged_circle,
    render_mark,
    render_plate,
    tilted_shape,
)

COLUMNS, ROWS = 4, 3
RMS_GOAL_PX, BIAS_GOAL_PX, BOUND_GOAL, OPENCV_GOAL = 0.012, 0.005, 1.5, 3.0
_CAUGHT = 3.0  # pixels within which an answer belongs to a mark
_GROUND = 190.0
_LIGHT_CHANGE = 0.1  # of the ground's level over an image


@dataclass(frozen=True)
class Conditions:
    """How the marks of an image look.

    Attributes
    ----------
    radius
        Pixels.
    tilt_deg
        Of the plate.
    contrast
        Between ground and mark, grey levels.
    blur
        Standard deviation, pixels.
    noise
        Standard deviation, grey levels.
    """

    radius: float = 18.0
    tilt_deg: float = 15.0
    contrast: float = 150.0
    blur: float = 1.0
    noise: float = 2.0


_AXES = {
    "radius": "radius, pixels", "tilt_deg": "tilt, degrees", "contrast": "contrast, grey levels",
    "blur": "blur, pixels", "noise": "noise, grey levels",
}  # fmt: skip
SWEEPS: Mapping[str, tuple[float, ...]] = {
    "radius": (6.0, 9.0, 12.0, 18.0, 25.0, 35.0),
    "tilt_deg": (0.0, 15.0, 30.0, 45.0),
    "contrast": (30.0, 75.0, 150.0, 185.0),
    "blur": (0.5, 0.7, 1.0, 1.5, 2.5),
    "noise": (0.5, 1.0, 2.0, 4.0, 8.0),
}

Locate = Callable[[Image, RoughMarks], Array]


def _ours(method: str, **choice: str) -> Locate:
    def locate(image: Image, rough: RoughMarks) -> Array:
        return locate_marks(image, rough, method, **choice).points

    return locate


def _peer(name: str) -> Locate:
    def locate(image: Image, rough: RoughMarks) -> Array:
        return PEERS[name](image, (COLUMNS, ROWS))

    return locate


MARK_METHODS: dict[str, Locate] = {
    "ellipse": _ours("ellipse"),
    **{f"edge_ellipse/{operator}": _ours("edge_ellipse", operator=operator) for operator in OPERATORS},
    "arctan_edges": _ours("arctan_edges"),
    "weight_point": _ours("weight_point"),
    **{f"centroid/{threshold}": _ours("centroid", threshold=threshold) for threshold in THRESHOLDS},
    **{name: _peer(name) for name in PEERS},
}
"""Every way, by the name that the table gives it."""

_DRAWN = (
    "ellipse",
    "edge_ellipse/canny",
    "arctan_edges",
    "weight_point",
    "centroid/otsu",
    "opencv_circle_grid",
    "skimage_contour",
)


def draw_image(conditions: Conditions, rng: np.random.Generator) -> tuple[Image, Array, RenderedMark]:
    """Image of a dozen marks of one kind, their centres (12, 2), and one of them in a window of its own."""
    cell = 2 * math.ceil(2.0 * conditions.radius + 4.0 * conditions.blur + 4.0)
    shape = tilted_shape(
        conditions.radius, math.radians(conditions.tilt_deg), float(rng.uniform(0.0, math.pi))
    )
    direction = rng.uniform(0.0, 2.0 * math.pi)
    change = _LIGHT_CHANGE / (COLUMNS * cell)
    slope = (change * math.cos(direction), change * math.sin(direction))
    grey = np.empty((ROWS * cell, COLUMNS * cell))
    centres = []
    first = None
    for row in range(ROWS):
        for column in range(COLUMNS):
            x, y = cell / 2.0 + rng.uniform(-0.5, 0.5, 2)
            level = _GROUND * (1.0 + slope[0] * (column - 1.5) * cell + slope[1] * (row - 1.0) * cell)
            contrast = conditions.contrast * level / _GROUND
            mark = RenderedMark((x, y), shape, conditions.blur, contrast, level, slope)
            grey[row * cell : (row + 1) * cell, column * cell : (column + 1) * cell] = render_mark(mark, cell)
            centres.append((column * cell + x, row * cell + y))
            first = first or mark
    assert first is not None
    return as_camera(grey, conditions.noise, rng), np.array(centres), first


def cramer_rao(mark: RenderedMark, noise: float) -> Array:
    """Least covariance (2, 2) that an unbiased estimate of a mark's centre can have, pixels².

    Unknown besides the centre: shape, blur, levels of mark and ground, change of light over x and y. Rounding
    to grey levels counts as noise of variance 1/12.
    """
    size = 2 * math.ceil(float(mark.centre[0]))
    s = mark.shape

    def image(p: Array) -> Array:
        changed = RenderedMark(
            centre=(float(p[0]), float(p[1])),
            shape=np.array([[p[2], p[3]], [p[3], p[4]]]),
            blur=float(p[5]),
            contrast=float(p[6]),
            ground=float(p[7]),
            slope=(float(p[8]), float(p[9])),
        )
        return render_mark(changed, size)

    x, y = mark.centre
    at = np.array(
        [x, y, s[0, 0], s[0, 1], s[1, 1], mark.blur, mark.contrast, mark.ground, *mark.slope],
        dtype=np.float64,
    )
    steps = np.array([1e-3, 1e-3, 1e-2, 1e-2, 1e-2, 1e-3, 1e-1, 1e-1, 1e-5, 1e-5])
    columns = [(image(at + e) - image(at - e)).ravel() for e in np.diag(steps)]
    jacobian = np.column_stack(columns) / (2.0 * steps)
    # Columns of one size: parameters have different units.
    scale = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / scale
    inverse = np.linalg.inv(scaled.T @ scaled) / np.outer(scale, scale)
    return np.asarray((noise**2 + 1.0 / 12.0) * inverse[:2, :2], dtype=np.float64)


def errors_of(points: Array, centres: Array) -> Array:
    """Errors (K, 2) of the points that belong to a mark; each mark takes the nearest one."""
    if not len(points):
        return np.zeros((0, 2))
    offset = points[:, None] - centres
    distance = np.hypot(offset[..., 0], offset[..., 1])
    nearest = np.argmin(distance, axis=0)
    marks = np.arange(len(centres))
    caught = distance[nearest, marks] < _CAUGHT
    result: Array = offset[nearest, marks][caught]
    return result


@dataclass(frozen=True)
class Summary:
    """What the errors of one method in one kind of image come to.

    Attributes
    ----------
    found
        Share of the marks.
    bias_px
        Larger mean error of x and y.
    rms_px
        Root of the mean squared distance from the true centre.
    """

    found: float
    bias_px: float
    rms_px: float

    @classmethod
    def of(cls, errors: Array, count: int) -> Summary:
        """Summarise errors (K, 2) of `count` marks."""
        if not len(errors):
            return cls(0.0, math.nan, math.nan)
        bias = float(np.abs(errors.mean(axis=0)).max())
        return cls(len(errors) / count, bias, float(np.sqrt((errors**2).sum(axis=1).mean())))


def compare(
    images: list[Conditions],
    rng: np.random.Generator,
    told: Callable[[float], None] = lambda done: None,
    methods: Mapping[str, Locate] = MARK_METHODS,
) -> tuple[dict[str, Summary], float]:
    """Every method on one image of each kind, and the bound on the RMS distance, pixels."""
    errors: dict[str, list[Array]] = {name: [] for name in methods}
    bounds = []
    for n, conditions in enumerate(images):
        told(n / len(images))
        image, centres, mark = draw_image(conditions, rng)
        bounds.append(float(np.trace(cramer_rao(mark, conditions.noise))))
        rough = find_marks(image, least_radius=4.0)
        for name, locate in methods.items():
            errors[name].append(errors_of(locate(image, rough), centres))
    count = len(images) * COLUMNS * ROWS
    summaries = {name: Summary.of(np.concatenate(e), count) for name, e in errors.items()}
    return summaries, math.sqrt(float(np.mean(bounds)))


def perspective(tilt_deg: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Errors (K, 2) against the projected centres of a tilted plate's circles, and the same corrected."""
    width, height, distance, focal = 640, 480, 300.0, 1200.0
    tilt = math.radians(tilt_deg)
    turn = float(rng.uniform(0.0, 2.0 * math.pi))
    c, s = math.cos(turn), math.sin(turn)
    axis = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    lean = np.array(
        [[1.0, 0.0, 0.0], [0.0, math.cos(tilt), -math.sin(tilt)], [0.0, math.sin(tilt), math.cos(tilt)]]
    )
    rotation = lean @ axis
    k = np.array([[focal, 0.0, width / 2.0], [0.0, focal, height / 2.0], [0.0, 0.0, 1.0]])
    homography = k @ np.column_stack([rotation[:, 0], rotation[:, 1], [0.0, 0.0, distance]])
    pitch, radius = 15.0, 5.0
    grid = pitch * np.array([(i, j) for j in range(-2, 3) for i in range(-2, 3)], dtype=np.float64)
    grid += rng.uniform(-0.2, 0.2, grid.shape)
    image = as_camera(render_plate(homography, grid, radius, np.zeros(25), (width, height)), 2.0, rng)
    points = locate_marks(image, find_marks(image)).points
    ellipses = np.array([imaged_circle(homography, centre, radius)[0] for centre in grid])
    offset = points[:, None] - ellipses
    nearest = np.argmin(np.hypot(offset[..., 0], offset[..., 1]), axis=1)
    plane = grid[nearest]
    true = np.column_stack([plane, np.ones(len(plane))]) @ homography.T
    before = points - true[:, :2] / true[:, 2:]
    # The homography comes from the located marks themselves.
    seen = fit_grid_homography(plane, points)
    return before, before + homography_offsets(seen, plane, radius)


def _population(count: int, rng: np.random.Generator) -> list[Conditions]:
    return [
        Conditions(
            radius=float(rng.uniform(12.0, 25.0)),
            tilt_deg=float(rng.uniform(0.0, 30.0)),
            blur=float(rng.uniform(0.7, 1.5)),
        )
        for _ in range(count)
    ]


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `station.figures.RunStudy`."""
    rng = np.random.default_rng(seed)
    rows: list[Row] = []

    def add(factor: str, value: float | None, results: dict[str, Summary], bound: float) -> None:
        rows.extend(
            {
                "factor": factor,
                "value": value,
                "method": name,
                "found": result.found,
                "bias_px": result.bias_px,
                "rms_px": result.rms_px,
                "bound_px": bound,
            }
            for name, result in results.items()
        )

    progress(0.0, "marks of all kinds")
    images = _population(12 if quick else 60, rng)
    population, bound = compare(images, rng, lambda done: progress(0.5 * done, "marks of all kinds"))
    add("all", None, population, bound)
    for n, (factor, values) in enumerate(SWEEPS.items()):
        for value in (values[0], values[-1]) if quick else values:
            progress(0.5 + 0.4 * n / len(SWEEPS), f"{factor} {value:g}")
            kind = replace(Conditions(), **{factor: value})
            add(factor, value, *compare([kind] * (1 if quick else 4), rng))
    progress(0.9, "perspective")
    perspective_px = {}
    for tilt in (0.0, 15.0, 30.0, 45.0):
        pairs = [perspective(tilt, rng) for _ in range(2 if quick else 8)]
        for name, errors in (
            ("ellipse", np.concatenate([p[0] for p in pairs])),
            ("ellipse, corrected", np.concatenate([p[1] for p in pairs])),
        ):
            summary = Summary.of(errors, len(errors))
            add("perspective, tilt_deg", tilt, {name: summary}, math.nan)
            perspective_px[name, tilt] = summary.rms_px
    best, opencv = population["ellipse"], population["opencv_circle_grid"]
    figures = {
        "ellipse_rms_px": best.rms_px,
        "ellipse_bias_px": best.bias_px,
        "cramer_rao_px": bound,
        "ellipse_over_bound": best.rms_px / bound,
        "opencv_circle_grid_rms_px": opencv.rms_px,
        "opencv_over_ellipse": opencv.rms_px / best.rms_px,
        "edge_ellipse_rms_px": population["edge_ellipse/canny"].rms_px,
        "arctan_edges_rms_px": population["arctan_edges"].rms_px,
        "weight_point_rms_px": population["weight_point"].rms_px,
        "centroid_rms_px": population["centroid/otsu"].rms_px,
        "perspective_45deg_uncorrected_px": perspective_px["ellipse", 45.0],
        "perspective_45deg_corrected_px": perspective_px["ellipse, corrected", 45.0],
    }
    goals = (
        Goal("ellipse_rms_px", "at_most", RMS_GOAL_PX),
        Goal("ellipse_bias_px", "at_most", BIAS_GOAL_PX),
        Goal("ellipse_over_bound", "at_most", BOUND_GOAL),
        Goal("opencv_over_ellipse", "at_least", OPENCV_GOAL),
    )
    plots = {"marks_methods": _plot_methods(population, bound), "marks_sweeps": _plot_sweeps(rows)}
    progress(1.0, "done")
    return StudyResult(tuple(rows), figures, goals, _text(figures, len(images)), plots)


def _text(figures: Mapping[str, float], images: int) -> str:
    def px(name: str, digits: int = 4) -> str:
        return f"{figures[name]:.{digits}f}"

    return (
        f"{images * COLUMNS * ROWS} marks: radius 12–25 pixels, tilt up to 30°, blur 0.7–1.5 pixels, "
        "contrast 150 and noise 2 grey levels. The fit of a blurred ellipse errs by "
        f"{px('ellipse_rms_px')} pixels RMS (distance from the true centre of the outline), "
        f"{px('ellipse_over_bound', 2)} times the Cramér–Rao bound; OpenCV's circle grid by "
        f"{px('opencv_circle_grid_rms_px')}. The thesis's methods: weight point "
        f"{px('weight_point_rms_px')}, arctangent edges {px('arctan_edges_rms_px')}; its aim was a tenth "
        "of a pixel. A circle's centre lies beside its outline's centre in a tilted view: at 45° by "
        f"{px('perspective_45deg_uncorrected_px', 3)} pixels, of which the correction leaves "
        f"{px('perspective_45deg_corrected_px')}, the noise included."
    )


@in_style
def _plot_methods(population: dict[str, Summary], bound: float) -> Figure:
    figure = Figure(figsize=(8, 6), layout="constrained")
    axes = figure.add_subplot()
    names = list(population)[::-1]
    axes.barh(names, [population[name].rms_px for name in names])
    axes.axvline(bound, color=BAD, label="Cramér–Rao bound")
    axes.set_xscale("log")
    axes.set_xlabel("RMS distance from the true centre, pixels")
    axes.grid(visible=False, axis="y")
    legend_outside(figure)
    return figure


@in_style
def _plot_sweeps(rows: list[Row]) -> Figure:
    figure = Figure(figsize=(12, 7), layout="constrained")
    for n, factor in enumerate(SWEEPS):
        axes = figure.add_subplot(2, 3, n + 1)
        here = [row for row in rows if row["factor"] == factor]
        for name in _DRAWN:
            line = [row for row in here if row["method"] == name]
            axes.plot(_column(line, "value"), _column(line, "rms_px"), ".-", label=name)
        line = [row for row in here if row["method"] == _DRAWN[0]]
        axes.plot(_column(line, "value"), _column(line, "bound_px"), "--", color=REFERENCE, label="bound")
        axes.set_yscale("log")
        axes.set_xlabel(_AXES[factor])
        axes.set_ylabel("RMS, pixels")
    legend_outside(figure, figure.axes[:1], columns=4)
    return figure


def _column(rows: list[Row], name: str) -> Array:
    return np.array([row[name] for row in rows], dtype=np.float64)


STUDY = Study("marks", "Bias and noise of every way to locate a mark.", run)
