"""A rig prepared for measuring: what is computed once from its calibration, and serves every wheel after."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from alignment.arrays import Array, Index
from alignment.calibration.knocks import KnockModel, knock_model
from alignment.calibration.prediction import axis_covariance, predicted_misfits
from alignment.errors import DegenerateInputError
from alignment.stereo.correspondence import StereoGeometry
from alignment.stereo.overlap import shared_views
from alignment.stereo.rectification import epipolar_directions
from alignment.stereo.rows import RowViews
from alignment.values import HeadCalibration, MeasureSettings, RigCalibration

# Millimetres by which a head's patch of the tyre may fit better elsewhere: what the skin of a tyre explains,
# and so many deviations of what the calibration states; the second where it states none.
_LEAST_MISFIT, _UNSTATED_MISFIT, _DEVIATIONS = 0.003, 0.01, 3.0


@dataclass(frozen=True, eq=False)
class PreparedRig:
    """A calibration, and what follows from it alone; who measures repeatedly keeps one.

    Each part is computed when it is asked for the first time, and goes with this value: nothing else holds
    on to a calibration. Threads may share it; at worst they compute a part twice.

    Attributes
    ----------
    calibration
        Cameras and pose of the rig.
    depth_range_mm
        Lowest and highest z in which a tyre's surface may lie, rig frame, as in `MeasureSettings`.
    """

    calibration: RigCalibration
    depth_range_mm: tuple[float, float]

    @classmethod
    def of(cls, calibration: RigCalibration | PreparedRig, settings: MeasureSettings) -> PreparedRig:
        """Prepare a calibration; a rig that is prepared already is returned as it is.

        Raises
        ------
        DegenerateInputError
            When the rig was prepared for another depth range than that of the settings.
        """
        if isinstance(calibration, RigCalibration):
            return cls(calibration, settings.depth_range_mm)
        if calibration.depth_range_mm != settings.depth_range_mm:
            raise DegenerateInputError(
                field="depth_range_mm",
                expected="{:g} to {:g} mm, that of the settings".format(*settings.depth_range_mm),
                seen="a rig prepared for {:g} to {:g} mm".format(*calibration.depth_range_mm),
                cure="Prepare the rig with the settings that it measures with.",
            )
        return calibration

    @property
    def heads(self) -> tuple[HeadCalibration, ...]:
        """Of the calibration."""
        return self.calibration.heads

    @cached_property
    def without(self) -> tuple[PreparedRig, ...]:
        """For each head the rig without it, prepared; of two heads at least."""
        return tuple(
            PreparedRig(self.calibration.without_head(k), self.depth_range_mm) for k in range(len(self.heads))
        )

    @cached_property
    def epipolar_directions(self) -> Array:
        """(2 H, 2) as `rectification.epipolar_directions`."""
        return epipolar_directions(self.calibration)

    @cached_property
    def shared_views(self) -> Index:
        """(2 H, 4) as `overlap.shared_views`."""
        return shared_views(self.calibration, self.depth_range_mm)

    @cached_property
    def geometry(self) -> StereoGeometry:
        """Of the heads, for matching."""
        return StereoGeometry.of(self.heads)

    @cached_property
    def row_views(self) -> RowViews:
        """Of the heads, for the row differences of crosses."""
        return RowViews.of(self.heads)

    @cached_property
    def image_axes(self) -> Array:
        """(H, 3, 2) directions of the rows and columns of the heads' left images, rig frame."""
        return np.array([head.left.rig_from_camera.rotation[:, :2] for head in self.heads])

    @cached_property
    def angle_covariance(self) -> Array | None:
        """(2, 2) covariance of camber and toe by that of the calibration, on a nominal wheel, radians².

        The share of a calibration hardly depends on the wheel. None where it states no covariance; raises
        DegenerateInputError where its heads do not see the nominal wheel.
        """
        return None if self.axis_covariance is None else self.axis_covariance[:2, :2]

    @cached_property
    def axis_covariance(self) -> Array | None:
        """(5, 5) covariance of camber, toe and the wheel's reference point as `prediction.axis_covariance`.

        Of angles in radians and of a point in the vehicle frame in millimetres; otherwise as
        `angle_covariance`.
        """
        return None if self.calibration.covariance is None else axis_covariance(self.calibration)

    @cached_property
    def worst_misfit(self) -> float:
        """Largest misfit of a head, millimetres, were there no noise; raises as `angle_covariance`."""
        if self.calibration.covariance is None:
            return _UNSTATED_MISFIT
        return _LEAST_MISFIT + _DEVIATIONS * float(predicted_misfits(self.calibration).max())

    @cached_property
    def knock_model(self) -> KnockModel | None:
        """What is to be expected of the signs of knocks; None for heads that do not see the nominal wheel."""
        try:
            return knock_model(self.calibration)
        except DegenerateInputError:
            return None
