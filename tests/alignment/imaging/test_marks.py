import math

import cv2
import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.imaging import mark_ellipse as fit
from alignment.imaging.ellipses import fit_ellipse, refine_ellipse
from alignment.imaging.mark_detection import find_marks
from alignment.imaging.mark_location import METHODS, locate_marks
from alignment.imaging.marks import upper_factor
from station.studies.rendered_marks import RenderedMark, as_camera, coverage, render_mark, tilted_shape
from tests.alignment.imaging.plates import photograph, plate, project, view

WINDOW = 110


def drawn(rng: np.random.Generator, **changes: float) -> RenderedMark:
    kind = {
        "radius": rng.uniform(12, 25),
        "tilt": rng.uniform(0, 30),
        "blur": rng.uniform(0.7, 1.5),
        "hole": 0.0,
        **changes,
    }
    x, y = WINDOW / 2 + rng.uniform(-0.5, 0.5, 2)
    shape = tilted_shape(kind["radius"], math.radians(kind["tilt"]), rng.uniform(0, math.pi))
    slope = tuple(rng.normal(0.0, 0.001, 2))
    return RenderedMark((x, y), shape, kind["blur"], slope=(slope[0], slope[1]), hole=kind["hole"])


def supersampled(mark: RenderedMark, size: int, parts: int = 16) -> np.ndarray:
    """The same mark drawn with parts × parts points per pixel, by another way than the frequency domain."""
    y, x = (np.mgrid[: size * parts, : size * parts] + 0.5) / parts - 0.5
    offset = np.stack([x - mark.centre[0], y - mark.centre[1]], axis=-1)
    relative = np.einsum("...i,ij,...j->...", offset, np.linalg.inv(mark.shape), offset)
    fine = ((relative < 1.0) & (relative >= mark.hole**2)).astype(np.float64)
    fine = cv2.GaussianBlur(fine, (0, 0), mark.blur * parts)
    return fine.reshape(size, parts, size, parts).mean(axis=(1, 3))


@pytest.mark.parametrize("hole", [0.0, 0.4])
def test_the_renderer_agrees_with_supersampling(hole: float) -> None:
    mark = drawn(np.random.default_rng(4), radius=13.0, hole=hole, blur=0.8)
    mark = RenderedMark((24.3, 23.8), mark.shape, mark.blur, hole=hole)
    difference = coverage(mark, 48) - supersampled(mark, 48)
    assert np.abs(difference).max() < 0.01  # the supersampling's own coarseness
    assert abs(difference.mean()) < 1e-4


def errors_of(
    method: str, count: int, *, noise: float = 2.0, **changes: float
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (count, 2) and their predicted variances, of rendered marks."""
    rng = np.random.default_rng(7)
    errors, variances = [], []
    for _ in range(count):
        mark = drawn(rng, **changes)
        image = as_camera(render_mark(mark, WINDOW), noise, rng)
        marks = locate_marks(image, find_marks(image), method)
        assert len(marks) == 1
        assert marks.hollow[0] == (mark.hole > 0.0)
        errors.append(marks.points[0] - mark.centre)
        variances.append(np.diag(marks.covariance[0]))
    return np.array(errors), np.array(variances)


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt((errors**2).mean()))


def test_centres_are_exact_to_hundredths_of_a_pixel_and_without_bias() -> None:
    errors, _ = errors_of("ellipse", 150)
    assert rms(errors) < 0.006
    assert np.abs(errors.mean(axis=0)).max() < 0.0015


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"hole": 0.375},
        {"radius": 7.0, "blur": 0.7, "noise": 1.0},
        {"radius": 38.0, "tilt": 45.0},
        {"noise": 8.0},
        {"blur": 3.0},
    ],
)
def test_the_stated_covariance_is_the_scatter(changes: dict[str, float]) -> None:
    errors, variances = errors_of("ellipse", 100, **changes)
    assert rms(errors / np.sqrt(variances)) == pytest.approx(1.0, abs=0.2)


def test_without_noise_only_rounding_is_left() -> None:
    errors, _ = errors_of("ellipse", 30, noise=0.0)
    assert rms(errors) < 0.002


@pytest.mark.parametrize(
    ("method", "limit"), [("edge_ellipse", 0.01), ("arctan_edges", 0.02), ("weight_point", 0.07)]
)
def test_the_other_methods_keep_their_level(method: str, limit: float) -> None:
    errors, variances = errors_of(method, 40)
    assert rms(errors) < limit
    assert np.abs(errors.mean(axis=0)).max() < limit / 2
    assert 0.5 < rms(errors / np.sqrt(variances)) < 2.0


def test_derivatives_of_the_blurred_ellipse_are_those_of_its_formula() -> None:
    p = np.array([20.0, 21.0, 0.055, 0.01, 0.04, 1.1, 40.0, 190.0, 0.02, -0.03, 0.5, 0.1, -0.2])
    scale = math.sqrt(p[fit.A] * p[fit.C])
    given, numeric, dz = np.zeros((5, 13)), np.zeros((5, 13)), np.zeros(6)
    scratch = np.zeros(13)
    for row, place in enumerate([(18.4, 1.0), (-3.0, 25.0), (-14.0, -18.0), (6.0, 8.0), (1.0, -12.4)]):
        fit._row(*place, p, True, scale, given[row], dz)
        for k in range(13):
            step = 1e-6
            values = []
            for sign in (1.0, -1.0):
                q = p.copy()
                q[k] += sign * step
                x, y = place[0] + p[0] - q[0], place[1] + p[1] - q[1]
                values.append(fit._row(x, y, q, True, scale, scratch, dz))
            numeric[row, k] = (values[0] - values[1]) / (2 * step)
    # How the curvature's small shift changes with the shape is left out of the derivatives.
    assert (np.abs(given - numeric) < 0.05 * np.abs(numeric).max(axis=0)).all()


@pytest.mark.parametrize("bright", [False, True])
@pytest.mark.parametrize("sixteen", [False, True])
def test_polarity_and_depth_of_the_image_do_not_matter(bright: bool, sixteen: bool) -> None:
    seen, homography = plate(), view(tilt=20.0, turn=30.0)
    eight = photograph(seen, homography)
    image = np.asarray(255 - eight if bright else eight)
    if sixteen:
        image = image.astype(np.uint16) * 256
    reference = locate_marks(eight, find_marks(eight))
    marks = locate_marks(image, find_marks(image, bright=bright))
    assert len(marks) == len(reference) > 60
    # Among bright marks the change of light follows from the marks more than from the ground.
    np.testing.assert_allclose(marks.points, reference.points, atol=0.015 if bright else 1e-3)
    assert marks.hollow.sum() == 3


@pytest.mark.parametrize("slope", [(0.8, 0.0), (-0.4, 0.7)])
def test_uneven_light_hides_no_mark_and_moves_none(slope: tuple[float, float]) -> None:
    seen, homography = plate(), view(distance=330.0)
    image = photograph(seen, homography, slope=slope, noise=1.0, ground=160.0, mark=25.0)
    marks = locate_marks(image, find_marks(image))
    truth = project(homography, seen.points)
    assert len(marks) == len(truth)
    nearest = np.argmin(np.hypot(*(marks.points[:, None] - truth).transpose(2, 0, 1)), axis=1)
    error = marks.points - truth[nearest]
    assert rms(error) < 0.006
    assert np.abs(error.mean(axis=0)).max() < 0.0015


def test_a_dirty_spot_on_the_edge_hardly_moves_the_centre() -> None:
    rng = np.random.default_rng(2)
    mark = drawn(rng, radius=20.0, tilt=0.0, blur=1.0)
    image = as_camera(render_mark(mark, WINDOW), 2.0, rng)
    x, y = round(mark.centre[0] + 20), round(mark.centre[1])
    image[y - 1 : y + 2, x - 1 : x + 2] = 60
    marks = locate_marks(image, find_marks(image))
    assert len(marks) == 1
    assert np.hypot(*(marks.points[0] - mark.centre)) < 0.05


def test_marks_that_the_border_cuts_are_left_out() -> None:
    rng = np.random.default_rng(3)
    for shift, whole in [(0.4, True), (2.0, True), (-2.0, False), (-8.0, False), (-15.0, False)]:
        big = render_mark(RenderedMark((60.0, 60.0), tilted_shape(20.0, 0.0, 0.0)), 120)
        first = 40 - round(shift)  # the mark's outline begins at pixel 40
        image = as_camera(big[:, first:], 2.0, rng)
        marks = locate_marks(image, find_marks(image))
        assert len(marks) == whole, f"outline {shift} pixels inside"


@pytest.mark.parametrize("level", [0, 9, 128, 255])
def test_an_even_image_has_no_marks(level: int) -> None:
    assert len(find_marks(np.full((240, 320), level, np.uint8))) == 0


def test_noise_alone_has_no_marks() -> None:
    rng = np.random.default_rng(5)
    for sigma in (2.0, 12.0):
        image = rng.normal(90.0, sigma, (480, 640)).clip(0, 255).astype(np.uint8)
        assert len(find_marks(image)) == 0


def test_letters_bars_and_squares_are_no_marks() -> None:
    image = np.full((480, 640), 190, np.uint8)
    cv2.putText(image, "TRUEWHEEL 382", (20, 120), cv2.FONT_HERSHEY_SIMPLEX, 2.0, (40,), 8)
    cv2.rectangle(image, (60, 200), (100, 240), (40,), -1)
    cv2.rectangle(image, (160, 200), (300, 215), (40,), -1)
    cv2.fillPoly(image, [np.array([[400, 250], [440, 250], [420, 210]])], (40,))
    cv2.ellipse(image, (520, 230), (40, 5), 0, 0, 360, (40,), -1)
    image[300:, :320] = 15
    marks = locate_marks(image, find_marks(image))
    assert len(marks) == 0


def test_a_plate_before_black_shows_its_whole_marks_only() -> None:
    seen, homography = plate(), view(tilt=30.0, distance=420.0)
    image = photograph(seen, homography)
    outside = project(homography, np.array([[-8.0, -8.0], [158.0, -8.0], [158.0, 128.0], [-8.0, 128.0]]))
    mask = np.zeros(image.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.rint(outside).astype(np.int32), (1,))
    image = np.where(mask == 1, image, np.uint8(6))
    truth = project(homography, seen.points)
    marks = locate_marks(image, find_marks(image))
    assert len(marks) == len(truth)


def test_unknown_methods_and_wrong_images_are_refused() -> None:
    image = photograph(plate(), view())
    rough = find_marks(image)
    for arguments in ({"method": "best"}, {"threshold": "best"}, {"operator": "best"}):
        with pytest.raises(DegenerateInputError, match="'best'"):
            locate_marks(image, rough, **arguments)
    with pytest.raises(DegenerateInputError, match="threshold"):
        find_marks(image, threshold="best")
    with pytest.raises(DegenerateInputError, match="rough marks"):
        locate_marks(image[:100], rough)
    with pytest.raises(DegenerateInputError, match="one channel"):
        find_marks(np.zeros((100, 100, 3), np.uint8))
    with pytest.raises(DegenerateInputError, match="radii"):
        find_marks(image, least_radius=30.0, largest_radius=20.0)


def test_no_rough_marks_give_no_marks() -> None:
    image = np.full((100, 120), 90, np.uint8)
    for method in METHODS:
        marks = locate_marks(image, find_marks(image), method)
        assert len(marks) == 0
        assert marks.covariance.shape == (0, 2, 2)


def test_ellipse_through_points() -> None:
    rng = np.random.default_rng(8)
    shape = tilted_shape(20.0, 0.6, 0.4)
    angle = np.linspace(0.0, 2.0 * math.pi, 90, endpoint=False)
    outline = np.column_stack([np.cos(angle), np.sin(angle)]) @ np.linalg.inv(upper_factor(shape[None])[0]).T
    middle = np.array([55.0, 44.0])
    centre, found = fit_ellipse(outline + middle)
    np.testing.assert_allclose(centre, [55.0, 44.0], atol=1e-9)
    np.testing.assert_allclose(found, shape, rtol=1e-9)
    errors, variances = [], []
    for _ in range(200):
        noisy = outline + middle + rng.normal(0.0, 0.1, outline.shape)
        refined, _, covariance, _ = refine_ellipse(noisy, *fit_ellipse(noisy))
        errors.append(refined - [55.0, 44.0])
        variances.append(np.diag(covariance))
    assert rms(np.array(errors) / np.sqrt(variances)) == pytest.approx(1.0, abs=0.12)
    with pytest.raises(DegenerateInputError, match="6 points"):
        fit_ellipse(outline[:5])
    with pytest.raises(DegenerateInputError):
        fit_ellipse(np.column_stack([angle, 2.0 * angle]))
