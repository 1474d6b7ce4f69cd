"""Calibrations to and from other programs: exact round trips, foreign files, models that cannot be held."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from textwrap import dedent

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from alignment.errors import ConfigurationError, FormatError
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.values import HeadCalibration, RigCalibration, nominal_vehicle_from_rig
from sensors.formats.exchange import (
    FORMATS,
    baselines_mm,
    export_calibration,
    import_calibration,
    import_cameras,
)
from tests.strategies import transforms

NUMBERS = [-0.08, 0.01, 3e-4, -1e-5, 1 / 300, 0.01, 0.02, 1e-3, 1e-4, 2e-4, -1e-4, 1e-4, 0.01, -0.02]


def model(coefficients: int = 5, seed: int = 1) -> CameraModel:
    rng = np.random.default_rng(seed)
    numbers = tuple(NUMBERS[:coefficients])
    return CameraModel(1280, 1024, 3000 + rng.normal(), 3001 + rng.normal(), 640.3, 509.7, "brown", numbers)


def rig(coefficients: int = 5, poses: list[RigidTransform] | None = None) -> RigCalibration:
    rng = np.random.default_rng(2)
    if poses is None:
        turned = [np.array([0.01, np.pi, 0.02]) + rng.normal(0, 0.01, 3) for _ in range(4)]
        poses = [RigidTransform.from_rotvec(turn, rng.normal(0, 300, 3)) for turn in turned]
    cameras = [PosedCamera(model(coefficients, n), pose) for n, pose in enumerate(poses)]
    heads = (HeadCalibration("head_1", *cameras[:2]), HeadCalibration("upper.2", *cameras[2:]))
    return RigCalibration("made-1", "front_right", "right", heads, nominal_vehicle_from_rig("right"))


def for_kalibr(calibration: RigCalibration) -> RigCalibration:
    """The same without k3, which Kalibr does not have."""
    heads = tuple(
        HeadCalibration(
            head.name,
            *(
                replace(
                    camera, model=replace(camera.model, coefficients=(*camera.model.coefficients[:4], 0.0))
                )
                for camera in head.cameras
            ),
        )
        for head in calibration.heads
    )
    return replace(calibration, heads=heads)


def assert_same(one: RigCalibration, other: RigCalibration) -> None:
    assert (one.rig, one.side) == (other.rig, other.side)
    assert sorted(head.name for head in one.heads) == sorted(head.name for head in other.heads)
    by_name = {head.name: head for head in other.heads}
    for head in one.heads:
        for a, b in zip(head.cameras, by_name[head.name].cameras, strict=True):
            assert (a.model.width, a.model.height) == (b.model.width, b.model.height)
            assert np.abs(a.model.parameters - b.model.parameters).max() < 1e-9
            assert np.abs(a.rig_from_camera.rotation - b.rig_from_camera.rotation).max() < 1e-9
            assert np.abs(a.rig_from_camera.translation - b.rig_from_camera.translation).max() < 1e-9


def round_trip(path: Path, calibration: RigCalibration, kind: str) -> RigCalibration:
    export_calibration(path, calibration, kind)
    return import_calibration([path], kind, identity="back", rig=calibration.rig, side=calibration.side)


@pytest.mark.parametrize(
    ("kind", "coefficients"),
    [*(("opencv", n) for n in (5, 8, 12, 14)), *(("mrcal", n) for n in (5, 8, 12)), ("kalibr", 5)],
)
def test_a_calibration_comes_back_exactly(tmp_path: Path, kind: str, coefficients: int) -> None:
    calibration = rig(coefficients)
    if kind == "kalibr":
        calibration = for_kalibr(calibration)
    back = round_trip(tmp_path / "calibration.yaml", calibration, kind)
    assert_same(calibration, back)
    assert back.id == "back"


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(poses=st.lists(transforms(), min_size=4, max_size=4), kind=st.sampled_from(FORMATS))
def test_every_pose_comes_back(tmp_path: Path, poses: list[RigidTransform], kind: str) -> None:
    calibration = for_kalibr(rig(5, poses))
    assume(all(5 < length < 5000 for length in baselines_mm(calibration).values()))
    folder = tmp_path / f"{len(list(tmp_path.iterdir()))}"
    assert_same(calibration, round_trip(folder, calibration, kind))


def test_opencv_projects_with_what_was_written_as_truewheel_does(tmp_path: Path) -> None:
    calibration = rig(14)
    export_calibration(tmp_path / "c.yaml", calibration, "opencv")
    storage = cv2.FileStorage(str(tmp_path / "c.yaml"), cv2.FILE_STORAGE_READ)
    entry = storage.getNode("cameras").at(1)
    camera = calibration.heads[0].right
    rng = np.random.default_rng(4)
    points = camera.rig_from_camera.apply(rng.uniform([-60, -50, 350], [60, 50, 450], (20, 3)))
    k, d, r, t = (entry.getNode(n).mat() for n in ("camera_matrix", "distortion_coefficients", "R", "T"))
    pixels = cv2.projectPoints(points, cv2.Rodrigues(r)[0], t, k, d)[0][:, 0]
    assert entry.getNode("name").string() == "head_1.right"
    assert np.abs(pixels - camera.project(points)).max() < 1e-7


def test_a_file_of_opencvs_calibration_sample_is_a_lens_without_a_pose(tmp_path: Path) -> None:
    path = tmp_path / "out_camera_data.yml"
    path.write_text(
        dedent("""\
            %YAML:1.0
            ---
            calibration_time: "Sun Mar  1 12:00:00 2026"
            nr_of_frames: 12
            image_width: 752
            image_height: 582
            board_width: 9
            flags: 0
            camera_matrix: !!opencv-matrix
               rows: 3
               cols: 3
               dt: d
               data: [ 1771.2, 0., 375.9, 0., 1827.6, 290.1, 0., 0., 1. ]
            distortion_coefficients: !!opencv-matrix
               rows: 4
               cols: 1
               dt: d
               data: [ -7.9e-02, 1.2e-02, 1.0e-04, -2.0e-04 ]
            avg_reprojection_error: 0.11
        """),
        encoding="utf-8",
    )
    (camera,) = import_cameras([path], "opencv")
    assert camera.name == "out_camera_data"
    assert camera.reference_from_camera is None
    assert camera.model == CameraModel(
        752, 582, 1771.2, 1827.6, 375.9, 290.1, "brown", (-0.079, 0.012, 1e-4, -2e-4, 0.0)
    )
    with pytest.raises(FormatError, match="expected the pose of every camera in one frame, found none"):
        import_calibration([path], "opencv", identity="x", rig="r", side="left")


STEREO = (
    """\
    %YAML:1.0
    ---
    M1: !!opencv-matrix
       rows: 3
       cols: 3
       dt: d
       data: [ 3000., 0., 640., 0., 3001., 512., 0., 0., 1. ]
    D1: !!opencv-matrix
       rows: 1
       cols: 5
       dt: d
       data: [ -0.08, 0.01, 0., 0., 0. ]
    M2: !!opencv-matrix
       rows: 3
       cols: 3
       dt: d
       data: [ 3002., 0., 641., 0., 3003., 511., 0., 0., 1. ]
    D2: !!opencv-matrix
       rows: 1
       cols: 8
       dt: d
       data: [ -0.08, 0.01, 0., 0., 0., 0., 0., 0. ]
    """,
    """\
    %YAML:1.0
    ---
    R: !!opencv-matrix
       rows: 3
       cols: 3
       dt: d
       data: [ 0.999950, 0., 0.0099998, 0., 1., 0., -0.0099998, 0., 0.999950 ]
    T: !!opencv-matrix
       rows: 3
       cols: 1
       dt: d
       data: [ -0.08, 0., 0.0004 ]
    """,
)


def test_the_two_files_of_opencvs_stereo_sample_make_a_head(tmp_path: Path) -> None:
    paths = [tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml"]
    for path, text in zip(paths, STEREO, strict=True):
        path.write_text(dedent(text), encoding="utf-8")
    with pytest.raises(FormatError, match=r"image_width.*Say the size of the images"):
        import_cameras(paths, "opencv")
    made = import_calibration(
        paths, "opencv", identity="s", rig="r", side="left", unit_mm=1000.0, size=(1280, 1024)
    )
    (head,) = made.heads
    assert head.left.model.fy == 3001.0
    assert len(head.right.model.coefficients) == 8
    # A point 80 mm to the right of the left camera lies straight ahead of the right one.
    seen = head.right.rig_from_camera.inverse().apply(np.array([80.0, 0.0, 400.0]))
    assert seen[0] == pytest.approx(4.0, abs=0.01)
    assert head.left.rig_from_camera.translation == pytest.approx([0, 0, 0])
    paths[1].unlink()
    with pytest.raises(FormatError, match=r"extrinsics\.yml.*no such file"):
        import_cameras(paths, "opencv", size=(1280, 1024))
    with pytest.raises(FormatError, match=r"field 'R': expected a matrix of 3 × 3 or 3"):
        import_cameras(paths[:1], "opencv", size=(1280, 1024))


CHAIN = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.27695497, 0.06712482, 8.7538e-4,
    1e-5]
  distortion_model: radtan
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.999988, 0.0, 0.0049, -0.11003785]
  - [0.0, 1.0, 0.0, 0.0]
  - [-0.0049, 0.0, 0.999988, 0.0008]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.27, 0.06, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [460.1, 459.0, 360.0, 247.0]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""


def test_a_chain_of_kalibr_starts_at_its_first_camera(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(CHAIN, encoding="utf-8")
    made = import_calibration([path], "kalibr", identity="k", rig="r", side="left")
    (head,) = made.heads
    assert head.name == "head_1"
    assert head.left.model == CameraModel(
        752, 480, 461.629, 460.152, 362.68, 246.049, "brown", (-0.27695497, 0.06712482, 8.7538e-4, 1e-5, 0.0)
    )
    assert np.array_equal(head.left.rig_from_camera.rotation, np.eye(3))
    # The centre of camera 1 is −Rᵀ t, in millimetres.
    assert head.right.rig_from_camera.translation == pytest.approx([110.0405, 0.0, -0.2608], abs=1e-3)


def test_a_chain_of_kalibr_with_an_inertial_unit_is_in_its_frame(tmp_path: Path) -> None:
    path = tmp_path / "camchain-imucam.yaml"
    pose = (
        "  T_cam_imu:\n  - [0, 1, 0, 0.07]\n  - [-1, 0, 0, -0.02]\n  - [0, 0, 1, 0.004]\n  - [0, 0, 0, 1]\n"
    )
    path.write_text(CHAIN.replace("cam0:\n", f"cam0:\n{pose}"), encoding="utf-8")
    first, second = import_cameras([path], "kalibr")
    assert first.reference_from_camera.translation == pytest.approx([-20.0, -70.0, -4.0])
    in_first = first.reference_from_camera.inverse() @ second.reference_from_camera
    assert in_first.translation == pytest.approx([110.0405, 0.0, -0.2608], abs=1e-3)


MRCAL = """\
# generated on 2026-03-01
{
    'lensmodel':  "LENSMODEL_OPENCV8",

    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': [ 1761.181055, 1761.250444, 1965.706996, 1087.518797, -0.01266096516, 0.03590794372,
                    -0.0002547045941, 0.0005275929652, 0.01968883397, 0.01482863541, -0.0562239888,
                    0.0500223357,],
    'valid_intrinsics_region': [ [ 0, 0 ], [ 0, 2199 ], ],
    # extrinsics are rt_fromref
    'extrinsics': [ 0., 3.14159265358979, 0., 0.04, -0.266, 0.4, ],
    'imagersize': [ 4000, 2200,],
    'icam_intrinsics': 0,
    'optimization_inputs': b'{HLe7SZ',
}
"""


def test_a_model_of_mrcal_is_posed_in_its_reference(tmp_path: Path) -> None:
    path = tmp_path / "camera-0.cameramodel"
    path.write_text(MRCAL, encoding="utf-8")
    (camera,) = import_cameras([path], "mrcal")
    assert camera.name == "camera-0"
    assert (camera.model.width, camera.model.height) == (4000, 2200)
    assert camera.model.coefficients[:2] == (-0.01266096516, 0.03590794372)
    assert camera.model.coefficients[7] == 0.0500223357
    # Turned about y, it looks down z from 400 mm above the origin: C = −Rᵀ t.
    assert camera.reference_from_camera.translation == pytest.approx([40.0, 266.0, 400.0], abs=1e-9)
    newer = MRCAL.replace("'extrinsics'", "'rt_cam_ref'")
    path.write_text(newer, encoding="utf-8")
    (again,) = import_cameras([path], "mrcal")
    assert np.array_equal(again.reference_from_camera.translation, camera.reference_from_camera.translation)


def test_pinhole_models_have_no_distortion(tmp_path: Path) -> None:
    text = CHAIN.replace(
        "[-0.27, 0.06, 0.0, 0.0]\n  distortion_model: radtan", "[]\n  distortion_model: none"
    )
    (tmp_path / "chain.yaml").write_text(text, encoding="utf-8")
    assert import_cameras([tmp_path / "chain.yaml"], "kalibr")[1].model.coefficients == (0.0,) * 5
    text = "{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [9, 8, 3, 4], 'imagersize': [7, 9], "
    (tmp_path / "p.cameramodel").write_text(text + "'extrinsics': [0, 0, 0, 0, 0, 0]}", encoding="utf-8")
    (camera,) = import_cameras([tmp_path], "mrcal")
    assert camera.model.matrix.tolist() == [[9, 0, 3], [0, 8, 4], [0, 0, 1]]


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize(
    ("change", "seen"),
    [
        (lambda m: replace(m, model="division", coefficients=(-0.08,)), "found model 'division'"),
        (lambda m: replace(m, skew=0.5), "found a skew of 0.5 pixels"),
    ],
)
def test_cameras_that_the_other_program_lacks_are_refused(
    tmp_path: Path, kind: str, change: Callable[[CameraModel], CameraModel], seen: str
) -> None:
    calibration = for_kalibr(rig())
    head = calibration.heads[1]
    right = replace(head.right, model=change(head.right.model))
    calibration = replace(calibration, heads=(calibration.heads[0], replace(head, right=right)))
    with pytest.raises(FormatError) as caught:
        export_calibration(tmp_path / "out", calibration, kind)
    assert seen in str(caught.value)
    assert caught.value.field == "upper.2.right"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("kind", "coefficients", "expected"),
    [
        ("mrcal", 14, "with 5 or 8 or 12 coefficients"),
        ("kalibr", 8, "with 5 coefficients"),
        ("kalibr", 5, "expected k3 = 0"),
    ],
)
def test_lens_models_that_the_other_program_lacks_are_refused(
    tmp_path: Path, kind: str, coefficients: int, expected: str
) -> None:
    with pytest.raises(FormatError, match=expected):
        export_calibration(tmp_path / "out", rig(coefficients), kind)


@pytest.mark.parametrize(
    ("kind", "text", "parts"),
    [
        ("kalibr", CHAIN.replace("pinhole", "omni", 1), ["cam0.camera_model", "'omni'"]),
        ("kalibr", CHAIN.replace("radtan", "equidistant"), ["cam0.distortion_model", "'equidistant'"]),
        ("kalibr", CHAIN.replace("[752, 480]", "[752]", 1), ["cam0.resolution"]),
        ("kalibr", CHAIN.replace("461.629", "-461.629"), ["cam0.fx, fy"]),
        ("kalibr", CHAIN.replace("0.999988", "0.9", 1), ["cam1.T_cn_cnm1", "a rotation"]),
        ("kalibr", CHAIN.replace("T_cn_cnm1", "T_c1_c0"), ["cam1.T_cn_cnm1", "the pose of the camera"]),
        ("kalibr", CHAIN.replace("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0, 2.0]"), ["last row 0 0 0 1"]),
        ("kalibr", CHAIN.replace("cam1:", "cam2:"), ["cam0, cam1, …"]),
        ("kalibr", CHAIN.replace("cam1:", "cam1"), ["an error", "line 11"]),
        ("kalibr", "just text", ["cam0, cam1, …, found other keys"]),
        ("mrcal", MRCAL.replace("OPENCV8", "SPLINED_STEREOGRAPHIC_order=3"), ["lensmodel", "mrcal-convert"]),
        ("mrcal", MRCAL.replace("1761.181055, ", ""), ["intrinsics", "expected 12 numbers", "found 11"]),
        ("mrcal", MRCAL.replace("'imagersize'", "'size'"), ["imagersize", "expected a value"]),
        ("mrcal", MRCAL.replace("[ 4000", "[ None"), ["imagersize[0]"]),
        ("mrcal", MRCAL.replace("0.04,", "open('/etc/passwd'),"), ["a camera model of mrcal", "an error"]),
        ("mrcal", "[1, 2]", ["a camera model of mrcal", "an error"]),
        ("opencv", "just text", ["calibration data of OpenCV", "line 1"]),
        ("opencv", "", ["calibration data of OpenCV", "another kind of file"]),
        ("opencv", dedent(STEREO[0]).replace("M1", "A"), ["field 'camera_matrix'", "found none"]),
        ("opencv", dedent(STEREO[0]).replace("3000., 0.,", "3000., 2.,"), ["field 'M1'", "fx 0 cx"]),
        ("opencv", dedent(STEREO[0]).replace("3000.", ".Nan"), ["field 'M1'", "finite numbers"]),
        ("opencv", dedent(STEREO[0]).replace("cols: 8", "cols: 7"), ["calibration data of OpenCV"]),
        ("opencv", "%YAML:1.0\n---\ncameras: []\n", ["field 'cameras'", "a list of cameras"]),
        ("opencv", "%YAML:1.0\n---\nfisheye_model: 1\n", ["field 'fisheye_model'", "no fisheye lenses"]),
    ],
)
def test_a_wrong_file_is_named(tmp_path: Path, kind: str, text: str, parts: list[str]) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FormatError) as caught:
        import_cameras([path], kind, size=(1280, 1024))
    for part in ("file.yaml", *parts):
        assert part in str(caught.value)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_missing_file_is_named(tmp_path: Path, kind: str) -> None:
    with pytest.raises(FormatError, match="none"):
        import_cameras([tmp_path / "none"], kind)


def test_cameras_without_a_partner_are_named(tmp_path: Path) -> None:
    export_calibration(tmp_path / "models", rig(), "mrcal")
    (tmp_path / "models" / "head_1_right.cameramodel").unlink()
    with pytest.raises(FormatError, match="one left and one right camera for each head") as caught:
        import_calibration([tmp_path / "models"], "mrcal", identity="x", rig="r", side="left")
    assert caught.value.field == "head_1"
    with pytest.raises(FormatError, match=r"\.cameramodel files, found none"):
        import_cameras([tmp_path], "mrcal")


def test_an_unknown_format_is_named(tmp_path: Path) -> None:
    for act in (
        lambda: export_calibration(tmp_path / "x", rig(), "ros"),
        lambda: import_cameras([tmp_path / "x"], "ros"),
    ):
        with pytest.raises(ConfigurationError, match="one of opencv, kalibr, mrcal, found 'ros'"):
            act()
