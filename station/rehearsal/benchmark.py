"""`measure_wheel` on six images in memory, beside dense stereo and a RANSAC plane on the same images.

The peers are what one would reach for without this program: OpenCV's semi-global matching on rectified
images, its points of all heads in the rig frame, and Open3D's RANSAC plane through them. A Gaussian blur of
the same six images is the floor that any look at every pixel stays above.

The measurement is timed in a process of its own that does nothing else, as a station's does: the renderer
and the peers bring thread pools along that would take the cores. Measurement and peers take turns, and each
turn gives a ratio, since a machine that others use too changes its speed from second to second.
"""

from __future__ import annotations

import json
import math
import pickle
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from alignment import measure, measure_heads
from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry import RigidTransform
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import (
    HeadCalibration,
    MeasureSettings,
    RigCalibration,
    StereoImages,
    WheelMeasurement,
)
from alignment.vehicle import camber_toe
from alignment.wheel import search

WARM_UP_S = 3.0  # until kernels are loaded and threads have found their cores
REWARM_UP = (
    0.1  # of it after another's turn, until caches are filled again and its threads have gone to sleep
)
ROUNDS, REPEATS = 7, 70
CAMBER, TOE, SEED = math.radians(1.0), math.radians(-0.5), 1
MOST_MS, LEAST_SPEEDUP, MOST_MEMORY_MB = 25.0, 60.0, 1000.0
#: What a measurement calls, by which module, in the order of its work.
TIMED_STAGES = {
    "extraction": (measure, "extract_many"),
    "correspondence": (measure, "match_heads"),
    "choice_of_surface": (measure, "plane_hypotheses"),
    "gloss": (search, "without_gloss"),
    "fit": (search, "fit_revolution"),
    "agreement_of_heads": (measure_heads, "head_moves"),
    "knocks": (measure_heads, "judged_shot"),
}


@dataclass(frozen=True)
class Sample:
    """A rendered wheel, the true cameras, and the true angles in radians."""

    images: Sequence[StereoImages]
    calibration: RigCalibration
    camber: float
    toe: float


def render_sample() -> Sample:
    """Render one wheel, 1280 × 1024, lettering and noise on."""
    from sensors.simulation import RIG_SPECS, build_rig, draw_pose, draw_scene, simulate_shot, truth_of

    rng = np.random.default_rng(SEED)
    spec = RIG_SPECS["standard"]
    calibration = build_rig(spec, "front_left", "left", rng)
    scene = draw_scene(spec, "left", draw_pose(rng, CAMBER, TOE), rng, seed=SEED)
    truth = truth_of(scene)
    images = simulate_shot(scene, calibration, rng).images
    return Sample(images, calibration, math.radians(truth.camber_deg), math.radians(truth.toe_deg))


class DenseStereo:
    """One head's peer: rectification tables made beforehand, then matching and reprojection per shot."""

    def __init__(self, head: HeadCalibration, depth_range: tuple[float, float]) -> None:
        left, right = head.left.model, head.right.model
        right_from_left = head.right.rig_from_camera.inverse() @ head.left.rig_from_camera
        size = (left.width, left.height)
        r1, r2, p1, p2, self._q, *_ = cv2.stereoRectify(
            left.matrix,
            np.array(left.coefficients),
            right.matrix,
            np.array(right.coefficients),
            size,
            right_from_left.rotation,
            right_from_left.translation.reshape(3, 1),
        )
        self._maps = [
            cv2.initUndistortRectifyMap(m.matrix, np.array(m.coefficients), r, p, size, cv2.CV_16SC2)
            for m, r, p in ((left, r1, p1), (right, r2, p2))
        ]
        self._rig_from_rectified = head.left.rig_from_camera @ RigidTransform(
            np.asarray(r1.T, dtype=np.float64), np.zeros(3)
        )
        height = head.left.rig_from_camera.translation[2]
        baseline = float(np.linalg.norm(right_from_left.translation))
        near, far = height - depth_range[1], height - depth_range[0]
        shift = p1[0, 2] - p2[0, 2]
        low = p1[0, 0] * baseline / far - abs(shift)
        count = math.ceil((p1[0, 0] * baseline * (1 / near - 1 / far) + 2 * abs(shift)) / 16 + 1) * 16
        self._matcher = cv2.StereoSGBM.create(
            minDisparity=int(low), numDisparities=count, blockSize=5, P1=200, P2=800, uniquenessRatio=10
        )

    def points(self, pair: StereoImages) -> Array:
        """Points (N, 3) of the lit pixels, rig frame."""
        left, right = (
            cv2.remap(image, *maps, cv2.INTER_LINEAR)
            for image, maps in zip((pair.left, pair.right), self._maps, strict=True)
        )
        disparity = self._matcher.compute(left, right).astype(np.float32) / 16.0
        points = cv2.reprojectImageTo3D(disparity, self._q)
        lit = (disparity > self._matcher.getMinDisparity()) & (left > 30)
        return self._rig_from_rectified.apply(points[lit].astype(np.float64))


def dense_plane(peers: Sequence[DenseStereo], images: Sequence[StereoImages]) -> Array:
    """Outboard normal (3,) of the RANSAC plane through the dense points of all heads."""
    import open3d as o3d

    points = np.concatenate([peer.points(pair) for peer, pair in zip(peers, images, strict=True)])
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    plane, _ = cloud.segment_plane(distance_threshold=5.0, ransac_n=3, num_iterations=1000)
    normal = np.asarray(plane[:3]) / np.linalg.norm(plane[:3])
    return normal if normal[2] > 0 else -normal


def median_ms(action: Callable[[], object], repeats: int) -> float:
    """Median wall time of an action, milliseconds, after one run to warm up."""
    action()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return statistics.median(times) * 1e3


def _milliseconds(images: Sequence[StereoImages], rig: PreparedRig, repeats: int) -> list[float]:
    """Wall times of measurements."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        measure_wheel(images, rig, MeasureSettings())
        times.append(1e3 * (time.perf_counter() - start))
    return times


def _stages(images: Sequence[StereoImages], rig: PreparedRig, repeats: int) -> dict[str, float]:
    """Median wall time of each stage, milliseconds; the clocks stay, so this comes last."""
    spent: dict[str, list[float]] = {stage: [] for stage in TIMED_STAGES}

    def timed(function: Callable[..., object], into: list[float]) -> Callable[..., object]:
        def call(*args: object, **keywords: object) -> object:
            start = time.perf_counter()
            result = function(*args, **keywords)
            into[-1] += 1e3 * (time.perf_counter() - start)
            return result

        return call

    for stage, (module, name) in TIMED_STAGES.items():
        setattr(module, name, timed(getattr(module, name), spent[stage]))
    for _ in range(repeats):
        for times in spent.values():
            times.append(0.0)
        measure_wheel(images, rig, MeasureSettings())
    return {stage: statistics.median(times) for stage, times in spent.items()}


def measure_alone() -> None:
    """Answer each line of standard input, a number of measurements, with their times; then with the stages'.

    The images come first, pickled, with the calibration and the seconds of both warm-ups. All answers are
    lines of JSON.
    """
    images, calibration, warm_up_s, rewarm_up_s = pickle.load(sys.stdin.buffer)
    rig = PreparedRig.of(calibration, MeasureSettings())

    def warm(seconds: float) -> None:
        end = time.perf_counter() + seconds
        while time.perf_counter() < end:
            measure_wheel(images, rig, MeasureSettings())

    warm(warm_up_s)
    rounds, repeats = 0, 1
    for line in sys.stdin.buffer:
        rounds, repeats = rounds + 1, int(line)
        warm(rewarm_up_s)
        sys.stdout.write(json.dumps(_milliseconds(images, rig, repeats)) + "\n")
        sys.stdout.flush()
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    stages = _stages(images, rig, rounds * repeats)
    sys.stdout.write(json.dumps({"peak_mb": peak_mb, "stages": stages}))


def run(repeats: int = REPEATS, warm_up_s: float = WARM_UP_S) -> dict[str, float]:
    """Time everything on one rendered wheel, in turns, and return the figures.

    Parameters
    ----------
    repeats
        Timed measurements, in seven turns where there are as many.
    warm_up_s
        Seconds of measuring before the first turn, and a tenth of it before every turn.
    """
    sample, settings = render_sample(), MeasureSettings()
    ours = measure_wheel(sample.images, sample.calibration, settings)
    if not isinstance(ours, WheelMeasurement):
        raise DegenerateInputError(field="sample", expected="a wheel that can be measured", seen=ours.reason)
    peers = [DenseStereo(head, settings.depth_range_mm) for head in sample.calibration.heads]
    normal = dense_plane(peers, sample.images)
    rotation = sample.calibration.vehicle_from_rig
    camber, toe = camber_toe(rotation.apply_vectors(normal), sample.calibration.side)
    every = [image for pair in sample.images for image in (pair.left, pair.right)]
    rounds = min(ROUNDS, repeats)
    per_round = math.ceil(repeats / rounds)

    turns = []
    with subprocess.Popen(
        [sys.executable, "-c", f"from {__name__} import measure_alone; measure_alone()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as alone:
        assert alone.stdin is not None
        assert alone.stdout is not None
        alone.stdin.write(pickle.dumps((sample.images, sample.calibration, warm_up_s, REWARM_UP * warm_up_s)))
        for _ in range(rounds):
            alone.stdin.write(b"%d\n" % per_round)
            alone.stdin.flush()
            answer = alone.stdout.readline()
            if not answer:
                raise RuntimeError(f"the process that measures ended with status {alone.wait()}")
            measure_ms = statistics.median(json.loads(answer))
            dense_ms = median_ms(lambda: dense_plane(peers, sample.images), 1)
            blur_ms = median_ms(lambda: [cv2.GaussianBlur(i, (0, 0), 1.5) for i in every], per_round)
            turns.append((measure_ms, dense_ms, blur_ms, dense_ms / measure_ms, measure_ms / blur_ms))
        rest = json.loads(alone.communicate()[0] or "null")
    if rest is None:
        raise RuntimeError(f"the process that measures ended with status {alone.returncode}")
    measure_ms, dense_ms, blur_ms, speedup, blurs = (
        statistics.median(column) for column in zip(*turns, strict=True)
    )
    return {
        "measure_wheel_ms": measure_ms,
        "sgbm_ransac_ms": dense_ms,
        "gaussian_blur_ms": blur_ms,
        "speedup_over_sgbm_ransac": speedup,
        "ratio_to_gaussian_blur": blurs,
        "peak_memory_mb": rest["peak_mb"],
        "camber_error_arcmin": (ours.camber - sample.camber) / ARCMIN,
        "toe_error_arcmin": (ours.toe - sample.toe) / ARCMIN,
        "sgbm_camber_error_arcmin": (camber - sample.camber) / ARCMIN,
        "sgbm_toe_error_arcmin": (toe - sample.toe) / ARCMIN,
        **{f"{stage}_ms": value for stage, value in rest["stages"].items()},
    }


def goals(
    figures: dict[str, float], least_speedup: float | None = None, most_ms: float | None = None
) -> bool:
    """Tell whether time, speed-up and memory are what they should be; by default, the product's goals."""
    return (
        figures["measure_wheel_ms"] <= (MOST_MS if most_ms is None else most_ms)
        and figures["speedup_over_sgbm_ransac"] >= (LEAST_SPEEDUP if least_speedup is None else least_speedup)
        and figures["peak_memory_mb"] < MOST_MEMORY_MB
    )
