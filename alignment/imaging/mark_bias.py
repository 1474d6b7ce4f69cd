"""Where the centre of a circle lies beside the centre of its image: perspective and distortion.

The image of a circle is (nearly) an ellipse whose centre is not the image of the circle's centre. For a plane
seen through a homography H the circle's conic C goes to H⁻ᵀ C H⁻¹; the image of the circle's centre is the
pole of the plane's vanishing line with respect to it, the ellipse's centre the pole of the line at infinity.
"""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.imaging.ellipses import conic_centres

_CONTOUR_POINTS = 48


def homography_offsets(image_from_plane: Array, centres: Array, radius: float) -> Array:
    """Projected centre minus ellipse centre of circles in a plane, pinhole imaging.

    Parameters
    ----------
    image_from_plane
        (3, 3) homography from the plane (millimetres) to the image (pixels), or (N, 3, 3), one for each
        circle.
    centres
        (N, 2) centres in the plane, millimetres.
    radius
        Of all circles, millimetres.

    Returns
    -------
    (N, 2) pixels: what is to be added to an ellipse's centre.
    """
    homography = np.broadcast_to(np.asarray(image_from_plane, dtype=np.float64), (len(centres), 3, 3))
    x, y = np.asarray(centres, dtype=np.float64).T
    one = np.ones_like(x)
    # Dual conic of the circle: adjugate of C up to scale, so that no inverse of H is needed.
    dual = np.stack([x * x - radius**2, x * y, x, x * y, y * y - radius**2, y, x, y, one], axis=1).reshape(
        -1, 3, 3
    )
    image = homography @ dual @ np.swapaxes(homography, 1, 2)
    ellipse = image[:, :2, 2] / image[:, 2:, 2]
    point = (homography @ np.stack([x, y, one], axis=1)[..., None])[..., 0]
    if (np.abs(point[:, 2]) < 1e-12).any() or not np.isfinite(ellipse).all():
        raise DegenerateInputError(
            field="image_from_plane", expected="circles in front of the camera", seen="one at infinity"
        )
    offset: Array = point[:, :2] / point[:, 2:] - ellipse
    return offset


def camera_offsets(camera: PosedCamera, centres: Array, normal: Array, radius: float) -> Array:
    """Projected centre minus the centre of the imaged outline, of circles in space; distortion included.

    The outline is mapped point by point and an ellipse fitted to it, as the locating methods do.

    Parameters
    ----------
    camera
        Model and pose.
    centres
        (N, 3) rig frame, millimetres.
    normal
        (3,) of the plane of all circles, rig frame.
    radius
        Of all circles, millimetres.

    Returns
    -------
    (N, 2) pixels: what is to be added to an ellipse's centre.

    Raises
    ------
    DegenerateInputError
        When the camera does not image a circle as a whole.
    """
    normal = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    angle = 2.0 * math.pi * np.arange(_CONTOUR_POINTS) / _CONTOUR_POINTS
    outline = radius * (np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second)
    points = (np.asarray(centres, dtype=np.float64)[:, None, :] + outline).reshape(-1, 3)
    pixels = camera.project(points).reshape(len(centres), _CONTOUR_POINTS, 2)
    offset: Array = camera.project(centres) - conic_centres(pixels)
    return offset
