"""Camera models: pixels to rays and back, exact in both directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry import distortion
from alignment.geometry.transforms import RigidTransform


@dataclass(frozen=True)
class CameraModel:
    """Pinhole with skew and lens distortion; pixel (0, 0) is the centre of the top-left pixel.

    Attributes
    ----------
    width, height
        Size of the image, pixels.
    fx, fy, cx, cy
        Focal lengths and principal point, pixels (p_x, p_y, C_x, C_y of the thesis).
    model
        ``division`` or ``brown`` (see `alignment.geometry.distortion`).
    coefficients
        Of the distortion: 1 for ``division``; 5, 8, 12 or 14 for ``brown``.
    skew
        Pixels; 0 for square-cut chips.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    model: str = "brown"
    coefficients: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    skew: float = 0.0

    def __post_init__(self) -> None:
        if self.model not in distortion.COEFFICIENT_NAMES:
            raise DegenerateInputError(
                field="model", expected="'division' or 'brown'", seen=f"'{self.model}'"
            )
        lengths = [len(names) for names in distortion.COEFFICIENT_NAMES[self.model]]
        if len(self.coefficients) not in lengths:
            raise DegenerateInputError(
                field="coefficients",
                expected=f"{' or '.join(map(str, lengths))} numbers for model '{self.model}'",
                seen=str(len(self.coefficients)),
            )
        values = (self.fx, self.fy, self.cx, self.cy, self.skew, *self.coefficients)
        if not np.isfinite(values).all() or self.fx <= 0 or self.fy <= 0:
            raise DegenerateInputError(
                field="fx, fy",
                expected="positive focal lengths and finite parameters",
                seen=", ".join(f"{value:g}" for value in values),
            )
        if self.width < 1 or self.height < 1:
            raise DegenerateInputError(
                field="width, height", expected="a positive size", seen=f"{self.width} × {self.height}"
            )
        object.__setattr__(self, "coefficients", tuple(float(c) for c in self.coefficients))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of `parameters`, in order."""
        names = next(n for n in distortion.COEFFICIENT_NAMES[self.model] if len(n) == len(self.coefficients))
        return ("fx", "fy", "cx", "cy", *names)

    @property
    def parameters(self) -> Array:
        """The intrinsic parameters that a calibration estimates: fx, fy, cx, cy, coefficients."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *self.coefficients])

    def with_parameters(self, parameters: Array) -> CameraModel:
        """Return the same kind of camera with other intrinsic parameters, ordered as `parameters`."""
        fx, fy, cx, cy, *coefficients = (float(value) for value in parameters)
        return CameraModel(
            self.width, self.height, fx, fy, cx, cy, self.model, tuple(coefficients), self.skew
        )

    @property
    def matrix(self) -> Array:
        """The (3, 3) calibration matrix K."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def packed(self) -> Array:
        """Return the vector that the compiled kernels read (`alignment.geometry.distortion`)."""
        vector = np.zeros(distortion.PACKED_SIZE)
        kind = distortion.DIVISION if self.model == "division" else distortion.BROWN
        vector[:6] = self.fx, self.fy, self.cx, self.cy, self.skew, kind
        vector[6 : 6 + len(self.coefficients)] = self.coefficients
        return vector

    def normalise(self, pixels: Array) -> Array:
        """Undistorted (x/z, y/z) of pixels (N, 2), as (N, 2).

        Raises
        ------
        DegenerateInputError
            When a pixel lies where the distortion has no inverse.
        """
        xy: Array
        xy, bad = distortion.unproject_many(np.ascontiguousarray(pixels, dtype=np.float64), self.packed())
        if bad:
            raise DegenerateInputError(
                field="pixels",
                expected="pixels that the lens model can invert",
                seen=f"{bad} of {len(xy)} without a ray",
            )
        return xy

    def unproject(self, pixels: Array) -> Array:
        """Unit rays (N, 3) in the camera frame of pixels (N, 2); errors as `normalise`."""
        rays: Array = np.column_stack([self.normalise(pixels), np.ones(len(pixels))])
        unit: Array = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return unit

    def project(self, points: Array) -> Array:
        """Pixels (N, 2) of points (N, 3) in the camera frame, millimetres.

        Raises
        ------
        DegenerateInputError
            When a point is not in front of the camera, or outside what the lens model images.
        """
        points = np.asarray(points, dtype=np.float64)
        behind = int((points[:, 2] <= 0).sum())
        if behind:
            raise DegenerateInputError(
                field="points", expected="points in front of the camera", seen=f"{behind} behind it"
            )
        xy = np.ascontiguousarray(points[:, :2] / points[:, 2:])
        pixels: Array
        pixels, bad = distortion.project_many(xy, self.packed())
        if bad:
            raise DegenerateInputError(
                field="points",
                expected="points that the lens model images",
                seen=f"{bad} of {len(points)} beyond its fold",
            )
        return pixels


@dataclass(frozen=True)
class PosedCamera:
    """A camera and where it stands.

    Attributes
    ----------
    model
        Its intrinsic parameters.
    rig_from_camera
        Its pose in the rig frame.
    """

    model: CameraModel
    rig_from_camera: RigidTransform

    def project(self, points_rig: Array) -> Array:
        """Pixels (N, 2) of points (N, 3) in the rig frame; errors as `CameraModel.project`."""
        return self.model.project(self.rig_from_camera.inverse().apply(points_rig))

    def rays(self, pixels: Array) -> Array:
        """Unit directions (N, 3) in the rig frame of pixels (N, 2); they start at the camera's centre."""
        return self.rig_from_camera.apply_vectors(self.model.unproject(pixels))
