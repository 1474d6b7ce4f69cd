"""Reads the wheels of the independent path tracer into the values of the program."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.values import HeadCalibration, RigCalibration, StereoImages, nominal_vehicle_from_rig

WHEELS = ("wheel_00", "wheel_03")


@dataclass(frozen=True)
class Truth:
    camber_deg: float
    toe_deg: float


def calibration(folder: Path) -> RigCalibration:
    """The true cameras of the path-traced rig."""
    cameras = {}
    for c in json.loads((folder / "rig.json").read_text(encoding="utf-8")):
        model = CameraModel(
            1280, 1024, c["fx"], c["fy"], c["cx"], c["cy"], "brown", (c["k1"], c["k2"], c["p1"], c["p2"], 0.0)
        )
        pose = RigidTransform(np.array(c["R"]).T, np.array(c["C"]))
        cameras[c["head"], c["side"]] = PosedCamera(model, pose)
    heads = tuple(HeadCalibration(f"head_{k}", cameras[k, "left"], cameras[k, "right"]) for k in (1, 2, 3))
    return RigCalibration("path-traced-truth", "path_traced", "left", heads, nominal_vehicle_from_rig("left"))


def images(folder: Path, wheel: str) -> list[StereoImages]:
    pairs = []
    for k in (1, 2, 3):
        left, right = (
            cv2.imread(str(folder / wheel / f"head_{k}_{side}.png"), cv2.IMREAD_UNCHANGED)
            for side in ("left", "right")
        )
        assert left is not None
        assert right is not None
        pairs.append(StereoImages(left, right))
    return pairs


def truth(folder: Path, wheel: str) -> Truth:
    values = json.loads((folder / wheel / "truth.json").read_text(encoding="utf-8"))
    return Truth(values["camber_tyre_deg"], values["toe_tyre_deg"])
