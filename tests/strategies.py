"""Hypothesis strategies for the values of the field."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import strategies as st

from alignment.geometry.cameras import CameraModel
from alignment.geometry.transforms import RigidTransform

sides = st.sampled_from(["left", "right"])
small_angles = st.floats(-math.radians(8), math.radians(8))


@st.composite
def transforms(draw: st.DrawFn) -> RigidTransform:
    axis = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 3)))
    length = float(np.linalg.norm(axis))
    axis = axis / length if length > 1e-3 else np.array([0.0, 0.0, 1.0])
    angle = draw(st.floats(-3.1, 3.1))
    shift = np.array(draw(st.tuples(*[st.floats(-1000, 1000)] * 3)))
    return RigidTransform.from_rotvec(angle * axis, shift)


@st.composite
def cameras(draw: st.DrawFn) -> CameraModel:
    """Cameras with the distortion that real lenses of this field have, over 1280 × 1024 pixels."""
    fx = draw(st.floats(1200, 4000))
    fy = fx * draw(st.floats(0.98, 1.02))
    cx, cy = draw(st.floats(600, 680)), draw(st.floats(480, 540))
    if draw(st.booleans()):
        return CameraModel(1280, 1024, fx, fy, cx, cy, "division", (draw(st.floats(-0.25, 0.1)),))
    size = draw(st.sampled_from([5, 8, 12, 14]))
    limits = [0.2, 0.1, 2e-3, 2e-3, 0.05, 0.05, 0.05, 0.02, 1e-3, 1e-3, 1e-3, 1e-3, 0.03, 0.03][:size]
    coefficients = tuple(draw(st.floats(-limit, limit)) for limit in limits)
    return CameraModel(1280, 1024, fx, fy, cx, cy, "brown", coefficients, skew=draw(st.floats(-2, 2)))
