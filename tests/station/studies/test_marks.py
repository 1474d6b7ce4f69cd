"""The study of marks, its short parts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from station.studies import marks
from station.studies.mark_peers import PEERS
from station.studies.marks import Conditions, compare, cramer_rao, draw_image, errors_of, perspective
from station.studies.rendered_marks import RenderedMark, tilted_shape


def test_the_ellipse_reaches_the_bound_and_leaves_opencv_behind() -> None:
    methods = {
        name: marks.MARK_METHODS[name] for name in ("ellipse", "opencv_circle_grid", "edge_ellipse/canny")
    }
    rng = np.random.default_rng(1)
    images = [
        Conditions(rng.uniform(12, 25), rng.uniform(0, 30), blur=rng.uniform(0.7, 1.5)) for _ in range(10)
    ]
    results, bound = compare(images, rng, methods=methods)
    ellipse, opencv = results["ellipse"], results["opencv_circle_grid"]
    assert ellipse.found == opencv.found == 1.0
    assert ellipse.rms_px < min(marks.RMS_GOAL_PX, marks.BOUND_GOAL * bound)
    assert ellipse.bias_px < marks.BIAS_GOAL_PX
    assert opencv.rms_px > marks.OPENCV_GOAL * ellipse.rms_px


def test_the_bound_is_that_of_a_blurred_edge_around_a_circle() -> None:
    """A blurred edge of contrast C tells of its place by ∫ (C φ(d/σ)/σ)² dd = C²/(2 √π σ) per pixel."""
    radius, blur, contrast, noise = 20.0, 1.2, 150.0, 2.0
    mark = RenderedMark((50.0, 50.0), tilted_shape(radius, 0.0, 0.0), blur, contrast)
    covariance = cramer_rao(mark, noise)
    # ∮ cos² ∫ (C φ(d/σ)/σ)² dd ds = C² π R / (2 √π σ), the pixel's integration counted to the blur.
    sigma = math.sqrt(blur**2 + 1.0 / 12.0)
    information = contrast**2 * math.pi * radius / (2.0 * math.sqrt(math.pi) * sigma)
    expected = math.sqrt((noise**2 + 1.0 / 12.0) / information)
    deviation = np.sqrt(np.diag(covariance))
    # Not knowing how the light changes costs a few percent.
    assert (deviation > 0.99 * expected).all()
    assert (deviation < 1.15 * expected).all()
    assert abs(covariance[0, 1]) < 1e-3 * covariance[0, 0]


@pytest.mark.parametrize("peer", PEERS)
def test_peers_find_every_mark(peer: str) -> None:
    image, centres, _ = draw_image(Conditions(), np.random.default_rng(3))
    errors = errors_of(PEERS[peer](image, (marks.COLUMNS, marks.ROWS)), centres)
    assert len(errors) == len(centres)
    assert np.sqrt((errors**2).mean()) < 0.1


def test_perspective_is_taken_off() -> None:
    before, after = perspective(45.0, np.random.default_rng(4))
    assert np.sqrt((before**2).sum(axis=1).mean()) > 0.1
    assert np.sqrt((after**2).sum(axis=1).mean()) < 0.01


def test_marks_that_nobody_found_do_not_count_as_exact() -> None:
    assert len(errors_of(np.zeros((0, 2)), np.array([[5.0, 5.0]]))) == 0
    assert len(errors_of(np.array([[50.0, 5.0]]), np.array([[5.0, 5.0]]))) == 0
    assert math.isnan(marks.Summary.of(np.zeros((0, 2)), 3).rms_px)
