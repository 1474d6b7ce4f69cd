"""Files of other programs as they are met: keys that change the meaning, frames, units, dialects."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import cv2
import numpy as np
import pytest
import yaml

from alignment.errors import FormatError
from alignment.geometry.transforms import RigidTransform
from alignment.values import RigCalibration
from sensors.formats.exchange import NamedCamera, baselines_mm, import_calibration, import_cameras

K1, D1 = [[1412.6, 0, 640.3], [0, 1412.9, 511.8], [0, 0, 1]], [-0.11, 0.09, 4e-4, -2e-4, 0.0]
K2, D2 = [[1409.1, 0, 630.7], [0, 1409.5, 520.2], [0, 0, 1]], [-0.10, 0.08, 3e-4, -1e-4, 0.0]
TURN = RigidTransform.from_rotvec(np.array([0.01, 0.2, -0.005]), np.array([-200.1, 0.5, 12.3]))
SIZE = {"image_width": 1280, "image_height": 1024}


def stored(path: Path, entries: dict[str, object]) -> Path:
    """Write entries as `cv2.FileStorage` does; lists become its matrices."""
    storage = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for key, value in entries.items():
        # The writer has no full stop in a key; readers and others' files do.
        storage.write(
            key.replace(".", "_STOP_"),
            np.array(value, dtype=float) if isinstance(value, list | np.ndarray) else value,
        )
    text = storage.releaseAndGetString().replace("_STOP_", ".")
    path.write_text(text, encoding="utf-8")
    return path


def pair(**more: object) -> dict[str, object]:
    """Return the entries of a pair, millimetres."""
    lenses = {"M1": K1, "D1": [D1], "M2": K2, "D2": [D2]}
    return {**SIZE, **lenses, "R": TURN.rotation, "T": TURN.translation[:, None], **more}


def head(cameras: tuple[NamedCamera, ...] | RigCalibration) -> RigidTransform:
    """Return left camera from right camera."""
    if isinstance(cameras, RigCalibration):
        left, right = (camera.rig_from_camera for camera in cameras.heads[0].cameras)
    else:
        left, right = (camera.reference_from_camera for camera in cameras)
    return left.inverse() @ right


def assert_pair(cameras: tuple[NamedCamera, ...] | RigCalibration) -> None:
    right_from_left = head(cameras).inverse()
    assert right_from_left.translation == pytest.approx(TURN.translation, abs=1e-6)
    assert right_from_left.rotation == pytest.approx(TURN.rotation, abs=1e-9)
    models = (
        [camera.model for camera in cameras.heads[0].cameras]
        if isinstance(cameras, RigCalibration)
        else [camera.model for camera in cameras]
    )
    assert [(m.fx, m.fy, m.cx, m.cy) for m in models] == [
        (1412.6, 1412.9, 640.3, 511.8),
        (1409.1, 1409.5, 630.7, 520.2),
    ]
    assert [m.coefficients for m in models] == [tuple(D1), tuple(D2)]


def read_pair(*paths: Path, unit_mm: float = 1.0) -> RigCalibration:
    return import_calibration(paths, "opencv", identity="i", rig="r", side="left", unit_mm=unit_mm)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("distortion_model", "equidistant"),
        ("distortion_model", "fisheye"),
        ("distortion_model", "kannala_brandt4"),
        ("distortion_model", "KANNALA-BRANDT"),
        ("distortion_model", "inverse_brown_conrady"),
        ("distortion_model", "a model of tomorrow"),
        ("distortion_type", "ATAN"),
        ("camera_model", "omni"),
        ("camera_model", "double sphere"),
        ("camera_model", "ds"),
        ("camera_model", "pinhole-equi"),
        ("model_type", "MEI"),
        ("model_type", "KANNALA_BRANDT"),
        ("lens_model", "Scaramuzza"),
        ("Camera.type", "KannalaBrandt8"),
        ("projection_model", "eucm"),
        ("fisheye_model", 1),
        ("is_fisheye", 1),
        ("xi", 1.79),
    ],
)
def test_a_lens_of_another_model_is_refused_wherever_the_file_says_so(
    tmp_path: Path, key: str, value: object
) -> None:
    """Only `fisheye_model` was looked at: k1 … k4 of an angle's polynomial became k1 k2 p1 p2."""
    path = stored(tmp_path / "pair.yml", pair(**{key: value}))
    with pytest.raises(FormatError, match=r"Brown and Conrady.*no fisheye lenses") as caught:
        import_cameras([path], "opencv")
    assert caught.value.field == key
    # Neither does it matter how deep it is said, nor by which reader the file goes.
    deep = tmp_path / "deep.yml"
    deep.write_text(yaml.safe_dump({"cameras": [{**SIZE, "info": {key: value}}]}), encoding="utf-8")
    with pytest.raises(FormatError, match=r"Brown and Conrady"):
        import_cameras([deep], "opencv")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("distortion_model", "plumb_bob"),
        ("distortion_model", "rational_polynomial"),
        ("distortion_model", "radial-tangential"),
        ("camera_model", "pinhole"),
        ("camera_model", "acA1300-60gm"),
        ("model_type", "PINHOLE"),
        ("camera_name", "omni_left"),
        ("fisheye_model", 0),
        ("type", "stereo"),
    ],
)
def test_a_lens_of_this_model_is_read_whatever_it_is_called(tmp_path: Path, key: str, value: object) -> None:
    assert_pair(read_pair(stored(tmp_path / "pair.yml", pair(**{key: value}))))


ALIKE = {
    "camera_model": "pinhole",
    "intrinsics": [1412.6, 1412.9, 640.3, 511.8],
    "distortion_model": "radtan",
    "distortion_coeffs": [-0.11, 0.09, 4e-4, -2e-4],
    "resolution": [1280, 1024],
}


def shifted(x: float, y: float = 0.0, z: float = 0.0) -> list[list[float]]:
    return [[1.0, 0, 0, x], [0, 1.0, 0, y], [0, 0, 1.0, z], [0, 0, 0, 1.0]]


def chain(path: Path, *poses: dict[str, object]) -> Path:
    data = {f"cam{n}": {**ALIKE, **pose} for n, pose in enumerate(poses)}
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


IN_UNIT = [{"T_cam_imu": shifted(0.05, 0.02, -0.3)}, {"T_cam_imu": shifted(-0.15, 0.02, -0.3)}]
INVERSE = [{"T_imu_cam": shifted(-0.05, -0.02, 0.3)}, {"T_imu_cam": shifted(0.15, -0.02, 0.3)}]
STEP = {"T_cn_cnm1": shifted(-0.2)}


@pytest.mark.parametrize(
    ("poses", "left", "right"),
    [
        (IN_UNIT, (-50, -20, 300), (150, -20, 300)),
        (INVERSE, (-50, -20, 300), (150, -20, 300)),
        ([INVERSE[0], {**INVERSE[1], **STEP}], (-50, -20, 300), (150, -20, 300)),
        ([INVERSE[0], IN_UNIT[1]], (-50, -20, 300), (150, -20, 300)),
        ([IN_UNIT[0], STEP], (-50, -20, 300), (150, -20, 300)),
        ([{}, {**IN_UNIT[1], **STEP}], (0, 0, 0), (200, 0, 0)),
        ([{}, {**INVERSE[1], **STEP}], (0, 0, 0), (200, 0, 0)),
        ([{}, STEP], (0, 0, 0), (200, 0, 0)),
    ],
)
def test_poses_of_a_chain_are_of_one_frame(
    tmp_path: Path, poses: list[dict[str, object]], left: tuple[float, ...], right: tuple[float, ...]
) -> None:
    """Two frames were mixed (336 mm apart instead of 200), and `T_imu_cam` was passed over."""
    cameras = import_cameras([chain(tmp_path / "chain.yaml", *poses)], "kalibr")
    for camera, centre in zip(cameras, (left, right), strict=True):
        assert camera.reference_from_camera is not None
        assert camera.reference_from_camera.translation == pytest.approx(centre, abs=1e-9)


@pytest.mark.parametrize(
    ("poses", "parts"),
    [
        ([{}, IN_UNIT[1]], ["cam1", "inertial unit", "none of cam0"]),
        ([{}, INVERSE[1]], ["cam1", "inertial unit", "T_imu_cam"]),
        ([IN_UNIT[0], {}], ["cam1.T_cn_cnm1", "found none"]),
        ([{}, {"T_c1_c0": shifted(-0.2)}], ["cam1", "T_c1_c0, which is not known"]),
        ([{"T_body_cam": shifted(0)}, STEP], ["cam0", "T_body_cam, which is not known"]),
        ([{**IN_UNIT[0], **INVERSE[1]}, STEP], ["cam0.T_imu_cam", "the inverse of T_cam_imu", "200 mm"]),
        ([IN_UNIT[0], {**IN_UNIT[1], "T_cn_cnm1": shifted(-0.21)}], ["cam1.T_cn_cnm1", "10 mm"]),
    ],
)
def test_poses_of_a_chain_that_make_no_frame_are_refused(
    tmp_path: Path, poses: list[dict[str, object]], parts: list[str]
) -> None:
    with pytest.raises(FormatError) as caught:
        import_cameras([chain(tmp_path / "chain.yaml", *poses)], "kalibr")
    for part in ("chain.yaml", *parts):
        assert part in str(caught.value)


def test_a_chain_with_opencvs_first_line_and_a_camera_twice(tmp_path: Path) -> None:
    path = chain(tmp_path / "kalibr_imucam_chain.yaml", {}, STEP)
    text = path.read_text(encoding="utf-8")
    path.write_bytes(("%YAML:1.0\n\n" + text).replace("\n", "\r\n").encode("utf-8-sig"))
    assert len(import_cameras([path], "kalibr")) == 2
    path.write_text(text.replace("cam1:", "cam0:"), encoding="utf-8")
    with pytest.raises(FormatError, match=r"'cam0' stands twice.*line"):
        import_cameras([path], "kalibr")


def test_two_files_of_a_camera_each_are_two_cameras_in_any_order(tmp_path: Path) -> None:
    """The second file's entries replaced the first one's: the left camera was the right one."""
    still, moved = (np.eye(3), np.zeros((3, 1))), (TURN.rotation, TURN.translation[:, None])
    paths = [
        stored(tmp_path / name, {**SIZE, "camera_matrix": k, "distortion_coefficients": [d], "R": r, "T": t})
        for name, k, d, (r, t) in (("left.yml", K1, D1, still), ("right.yml", K2, D2, moved))
    ]
    assert_pair(read_pair(*paths))
    assert_pair(read_pair(*reversed(paths)))
    other = tmp_path / "other.yml"
    other.write_bytes(paths[0].read_bytes())
    with pytest.raises(FormatError, match=r"cameras are 5 to 5000 mm apart, found 0 mm"):
        read_pair(paths[0], other)


def test_a_key_in_two_files_is_told_with_both(tmp_path: Path) -> None:
    one, other = (stored(tmp_path / name, pair()) for name in ("one.yml", "other.yml"))
    with pytest.raises(FormatError) as caught:
        read_pair(one, other)
    for part in ("one.yml and ", "other.yml, field 'M1'", "found it in both"):
        assert part in str(caught.value)
    # What does no harm may stand in both.
    pose = {key: value for key, value in pair().items() if key in ("R", "T", *SIZE)}
    lenses = {key: value for key, value in pair(calibration_time="a").items() if key not in ("R", "T")}
    parts = stored(tmp_path / "l.yml", lenses), stored(tmp_path / "p.yml", {**pose, "calibration_time": "b"})
    assert_pair(read_pair(*parts))


def test_an_error_names_the_file_that_holds_the_entry_or_all_that_lack_it(tmp_path: Path) -> None:
    """The first file was blamed for what belongs into the second."""
    lenses = stored(tmp_path / "lens.yml", {k: v for k, v in pair().items() if k not in ("R", "T")})
    pose = stored(tmp_path / "pose.yml", {"R": TURN.rotation, "Tvec": TURN.translation[:, None]})
    with pytest.raises(FormatError) as missing:
        read_pair(lenses, pose)
    assert "lens.yml and " in str(missing.value)
    assert "pose.yml, field 'T'" in str(missing.value)
    stored(pose, {"R": 2 * TURN.rotation, "T": TURN.translation[:, None]})
    with pytest.raises(FormatError, match="a rotation") as wrong:
        read_pair(lenses, pose)
    assert wrong.value.file == str(pose)


def test_metres_in_a_file_of_millimetres_are_noticed(tmp_path: Path) -> None:
    path = stored(tmp_path / "metres.yml", pair(T=TURN.translation[:, None] / 1000))
    with pytest.raises(FormatError, match=r"found 0\.2 mm for head_1.*may be in m\. Say that they are in m"):
        read_pair(path)
    made = read_pair(path, unit_mm=1000.0)
    assert_pair(made)
    assert baselines_mm(made)["head_1"] == pytest.approx(float(np.linalg.norm(TURN.translation)))


NAMES = [
    ("M1", "D1", "M2", "D2", "R", "T"),
    ("K1", "D1", "K2", "D2", "R", "T"),
    ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2", "R", "T"),
    ("cameraMatrixL", "distCoeffsL", "cameraMatrixR", "distCoeffsR", "R", "T"),
    (
        *("camera_matrix_left", "dist_coeffs_left", "camera_matrix_right", "dist_coeffs_right"),
        *("rotation_matrix", "translation_vector"),
    ),
    (
        *("camera_matrix_1", "distortion_coefficients_1", "camera_matrix_2", "distortion_coefficients_2"),
        *("R", "T"),
    ),
    ("K_left", "D_left", "K_right", "D_right", "R", "T"),
    ("left_K", "left_D", "right_K", "right_D", "R", "T"),
    ("LEFT.K", "LEFT.D", "RIGHT.K", "RIGHT.D", "R", "T"),
    ("K0", "D0", "K1", "D1", "R", "T"),
]


@pytest.mark.parametrize("names", NAMES, ids=lambda names: names[0])
@pytest.mark.parametrize("how", ["matrices", "lists", "flat", "rows-cols-data", "unindented"])
def test_pairs_by_other_names_and_of_plain_lists_are_read(
    tmp_path: Path, names: tuple[str, ...], how: str
) -> None:
    path = tmp_path / "pair.yml"
    values = (K1, [D1], K2, [D2], TURN.rotation.tolist(), TURN.translation[:, None].tolist())
    entries: dict[str, object] = dict(zip(names, values, strict=True))
    if how == "matrices":
        assert_pair(read_pair(stored(path, {**SIZE, **entries})))
        return
    if how == "flat":
        entries = {key: np.ravel(value).tolist() for key, value in entries.items()}
    if how == "rows-cols-data":
        entries = {
            key: {"rows": len(value), "cols": len(value[0]), "data": np.ravel(value).tolist()}
            for key, value in zip(names, values, strict=True)
        }
    text = yaml.safe_dump({**SIZE, **entries}, default_flow_style=None if how == "lists" else False)
    path.write_text("%YAML:1.0\n---\n" + text if how == "flat" else text, encoding="utf-8")
    assert_pair(read_pair(path))


CAMERA_INFO = """\
image_width: 1280
image_height: 1024
camera_name: narrow_stereo/{name}
camera_matrix:
  rows: 3
  cols: 3
  data: {k}
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {count}
  data: {d}
rectification_matrix:
  rows: 3
  cols: 3
  data: {r}
projection_matrix:
  rows: 3
  cols: 4
  data: {p}
"""


def test_camera_info_of_ros_is_a_lens_and_a_pair_of_it_a_head(tmp_path: Path) -> None:
    """A rectified pair states its pose through both rectifications and the right camera's projection."""
    r1, r2, p1, p2, *_ = cv2.stereoRectify(
        np.array(K1),
        np.array(D1),
        np.array(K2),
        np.array(D2),
        (1280, 1024),
        TURN.rotation,
        TURN.translation[:, None] / 1e3,
    )
    paths = []
    for name, k, d, r, p in (("left", K1, D1, r1, p1), ("right", K2, [*D2, 0.0, 0.0, 0.0], r2, p2)):
        paths.append(tmp_path / f"{name}.yaml")
        text = CAMERA_INFO.format(
            name=name,
            k=np.ravel(k).tolist(),
            d=d,
            count=len(d),
            model="plumb_bob" if len(d) == 5 else "rational_polynomial",
            r=np.ravel(r).tolist(),
            p=np.ravel(p).tolist(),
        )
        paths[-1].write_text(text, encoding="utf-8")
    (lens,) = import_cameras(paths[:1], "opencv")
    assert lens.reference_from_camera is None
    assert lens.model.coefficients == tuple(D1)
    made = read_pair(*paths, unit_mm=1000.0)
    assert len(made.heads[0].right.model.coefficients) == 8
    right_from_left = head(made).inverse()
    assert right_from_left.translation == pytest.approx(TURN.translation, abs=1e-6)
    assert right_from_left.rotation == pytest.approx(TURN.rotation, abs=1e-9)


def test_files_of_opencvs_older_samples_and_of_ros_messages(tmp_path: Path) -> None:
    older = stored(
        tmp_path / "older.yml",
        {"image_Width": 1280, "image_Height": 1024, "Camera_Matrix": K1, "Distortion_Coefficients": [D1]},
    )
    message = tmp_path / "message.yaml"
    message.write_text(
        yaml.safe_dump(
            {
                "width": 1280,
                "height": 1024,
                "distortion_model": "plumb_bob",
                "d": D1,
                "k": np.ravel(K1).tolist(),
            }
        ),
        encoding="utf-8",
    )
    models = [import_cameras([path], "opencv")[0].model for path in (older, message)]
    assert models[0] == models[1]
    assert models[0].coefficients == tuple(D1)


def test_two_lenses_and_a_pose_in_a_file_of_its_own(tmp_path: Path) -> None:
    lenses = [
        stored(tmp_path / f"{name}.yml", {"width": 1280, "height": 1024, "K": k, "D": [d]})
        for name, k, d in (("cam_left", K1, D1), ("cam_right", K2, D2))
    ]
    pose = stored(tmp_path / "extrinsic.yml", {"R": TURN.rotation, "T": TURN.translation[:, None]})
    assert_pair(read_pair(*lenses, pose))
    other = tmp_path / "third.yml"
    other.write_bytes(lenses[0].read_bytes())
    with pytest.raises(FormatError, match=r"extrinsic\.yml.*two cameras without a pose, found 3 cameras"):
        read_pair(*lenses, other, pose)


def test_a_key_twice_in_a_file_of_opencv_is_told(tmp_path: Path) -> None:
    path = stored(tmp_path / "twice.yml", pair())
    path.write_text(path.read_text(encoding="utf-8") + "image_width: 640\n", encoding="utf-8")
    with pytest.raises(FormatError, match=r"field 'image_width': expected each key once"):
        read_pair(path)


MODEL = """\
{{
    {lens},
    'intrinsics': [ 1761., 1762., 640., 512., -0.1, 0.03, 1e-4, 2e-4, ],
    {pose}: [ 0., 0., 0., 0.1, 0., 0., ],
    'imagersize': [ 1280, 1024,],
}}
"""


@pytest.mark.parametrize(
    "lens",
    [
        "'lensmodel': 'LENSMODEL_OPENCV4'",
        "'lens_model': 'LENSMODEL_OPENCV4'",
        "'distortion_model': 'DISTORTION_OPENCV4'",
        "'distortion_model': 'DISTORTION_OPENCV4', 'lens_model': 'LENSMODEL_OPENCV4'",
    ],
)
@pytest.mark.parametrize("pose", ["'extrinsics'", "'rt_cam_ref'"])
def test_models_of_mrcal_by_their_older_keys(tmp_path: Path, lens: str, pose: str) -> None:
    path = tmp_path / "a.cameramodel"
    path.write_bytes(dedent(MODEL).format(lens=lens, pose=pose).encode("utf-8-sig"))
    (camera,) = import_cameras([path], "mrcal")
    assert camera.model.coefficients == (-0.1, 0.03, 1e-4, 2e-4, 0.0)
    assert camera.reference_from_camera is not None
    assert camera.reference_from_camera.translation == pytest.approx([-100.0, 0, 0])


def test_a_model_of_mrcal_that_says_two_things_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.cameramodel"
    lens = "'lens_model': 'LENSMODEL_OPENCV4', 'lensmodel': 'LENSMODEL_CAHVOR'"
    path.write_text(MODEL.format(lens=lens, pose="'extrinsics'"), encoding="utf-8")
    with pytest.raises(FormatError, match=r"field 'lens_model': expected the same as under 'lensmodel'"):
        import_cameras([path], "mrcal")
    path.write_text(
        MODEL.format(lens="'distortion_model': 'DISTORTION_CAHVOR'", pose="'extrinsics'"), encoding="utf-8"
    )
    with pytest.raises(FormatError, match="'LENSMODEL_CAHVOR'"):
        import_cameras([path], "mrcal")


@pytest.mark.parametrize(
    ("files", "kind", "unit_mm", "said"),
    [
        (["fisheye-as-brown/pairf.yml"], "opencv", None, "'equidistant'"),
        (["kalibr-frames/k_mixed.yaml"], "kalibr", None, (200.0, 0.0, 0.0)),
        (["kalibr-frames/k_imucam.yaml"], "kalibr", None, (150.0, -20.0, 300.0)),
        (["opencv-two-files/left.yml", "opencv-two-files/right.yml"], "opencv", None, 1409.1),
        (
            ["opencv-two-files/intr.yml", "opencv-two-files/extr_bad.yml"],
            "opencv",
            None,
            "extr_bad.yml, field 'T'",
        ),
        (["opencv-unit/pair_m.yml"], "opencv", None, "found 0.2 mm"),
        (["opencv-unit/pair_m.yml"], "opencv", 1000.0, 1409.1),
    ],
)
def test_files_that_were_met_in_the_field(
    published_data: Path, files: list[str], kind: str, unit_mm: float | None, said: object
) -> None:
    paths = [published_data / "field_inputs" / name for name in files]
    if not all(path.exists() for path in paths):
        pytest.skip(f"published data not present: {paths[0].parent}")

    def read() -> RigCalibration:
        size = (1280, 1024)
        return import_calibration(paths, kind, identity="i", rig="r", side="left", unit_mm=unit_mm, size=size)

    if isinstance(said, str):
        with pytest.raises(FormatError) as caught:
            read()
        assert said in str(caught.value)
        return
    right = read().heads[0].right
    if isinstance(said, float):
        assert right.model.fx == said
    else:
        assert right.rig_from_camera.translation == pytest.approx(said)
