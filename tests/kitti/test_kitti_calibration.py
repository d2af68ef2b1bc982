"""Calibration: both spellings, frames, projection, bad files."""

from dataclasses import replace

import numpy as np
import pytest

from common.errors import InputError
from common.notes import note
from kitti.calibration import Calibration, read_calibration, write_calibration
from kitti.camera_view import image_size_of, parse_image_size

ONE = "1 0 0 0 0 1 0 0 0 0 1 0"
P = "700 0 600 40 0 700 170 0 0 0 1 0"
VELO = "0 -1 0 0 0 0 -1 0 1 0 0 -0.27"
EYE = "1 0 0 0 1 0 0 0 1"
TURNED = "0 -1 0 1 0 0 0 0 1"
PROJECTIONS = "".join(f"P{i}: {P}\n" for i in range(4))
NEW = f"{PROJECTIONS}R0_rect: {EYE}\nTr_velo_to_cam: {VELO}\nTr_imu_to_velo: {ONE}\n"
OLD = f"{PROJECTIONS}R_rect {EYE}\nTr_velo_cam {VELO}\nTr_imu_velo {ONE}\n"


def _fields(calib):
    others = (calib.tr_imu_to_velo, calib.p0, calib.p1, calib.p3)
    return [calib.p2, calib.r0_rect, calib.tr_velo_to_cam, *others]


def test_both_spellings_are_the_same(tmp_path):
    (tmp_path / "new.txt").write_text(NEW + "\n")
    (tmp_path / "old.txt").write_text(OLD.replace("\n", " \r\n"))
    new, old = read_calibration(tmp_path / "new.txt"), read_calibration(tmp_path / "old.txt")
    for a, b in zip(_fields(new), _fields(old), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(new.p2, np.array(P.split(), float).reshape(3, 4))


def test_both_files_of_the_raw_data_in_one(tmp_path):
    """calib_cam_to_cam.txt and then calib_velo_to_cam.txt."""
    camera = f"calib_time: 09-Jan-2012 13:57:47\nS_rect_02: 1242 375\nP_rect_02: {P}\n"
    velo = "R: 0 -1 0 0 0 -1 1 0 0\nT: 0 0 -0.27\ndelta_f: 0 0\n"
    (tmp_path / "raw.txt").write_text(f"{camera}R_rect_00: {EYE}\n{velo}")
    (tmp_path / "new.txt").write_text(NEW)
    raw, new = read_calibration(tmp_path / "raw.txt"), read_calibration(tmp_path / "new.txt")
    np.testing.assert_array_equal(raw.level_from_velo, new.level_from_velo)
    (tmp_path / "raw.txt").write_text(f"{camera}R_rect_00: {EYE}\n{velo.replace('-0.27', '-270')}")
    with pytest.raises(InputError, match=r"6: T: expected an offset of at most 20 metres"):
        read_calibration(tmp_path / "raw.txt")


def test_round_trip(tmp_path, calib):
    write_calibration(tmp_path / "c.txt", calib)
    again = read_calibration(tmp_path / "c.txt")
    assert _fields(again)[3:] == [None] * 4
    for a, b in zip(_fields(calib)[:3], _fields(again)[:3], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)
    others = {f"p{i}": calib.p2 + i * np.eye(3, 4, 3) for i in (0, 1, 3)}
    whole = replace(calib, tr_imu_to_velo=calib.tr_velo_to_cam, **others)
    write_calibration(tmp_path / "c.txt", whole)
    again = read_calibration(tmp_path / "c.txt")
    for a, b in zip(_fields(whole), _fields(again), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_axes_of_the_level_frame(tmp_path):
    (tmp_path / "c.txt").write_text(NEW)
    level = read_calibration(tmp_path / "c.txt").velo_to_level(np.eye(3) * 10)
    # This Velodyne is parallel to the level frame, 0.27 m behind camera 0.
    np.testing.assert_allclose(level, np.eye(3) * 10 - [0.27, 0, 0], atol=1e-12)


def test_points_are_rectified_after_they_came_to_the_camera():
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    to_camera = np.array([[0.0, -1, 0, 0.5], [0, 0, -1, -0.1], [1, 0, 0, -0.27]])
    calib = Calibration(p2=np.eye(4)[:3], r0_rect=quarter, tr_velo_to_cam=to_camera)
    # (10, 2, 1) -> camera 0 (-2 + 0.5, -1 - 0.1, 10 - 0.27) -> turned (1.1, -1.5, 9.73)
    level = calib.velo_to_level(np.array([[10.0, 2.0, 1.0]]))
    np.testing.assert_allclose(level, [[9.73, -1.1, 1.5]])


def test_level_to_velo_is_the_inverse(calib):
    xyz = np.random.default_rng(0).normal(0, 30, (50, 3))
    np.testing.assert_allclose(calib.level_to_velo(calib.velo_to_level(xyz)), xyz, atol=1e-9)


def test_projection_is_p2_times_camera_coordinates(calib):
    x, y, z = 3.0, -1.0, 12.0  # camera 0: right, down, forward
    u, v, depth = calib.p2 @ [x, y, z, 1]
    uv, found = calib.project_level(np.array([[z, -x, -y]]))
    np.testing.assert_allclose(uv[0], [u / depth, v / depth])
    np.testing.assert_allclose(found, depth)
    assert calib.project_level(np.zeros((0, 3)))[0].shape == (0, 2)


def test_colons_of_any_kind_and_projections_that_are_not_used(tmp_path):
    (tmp_path / "c.txt").write_text(NEW.replace(": ", ":").replace("P2:", "P2 : "))
    tight = read_calibration(tmp_path / "c.txt")
    np.testing.assert_array_equal(tight.p2, np.array(P.split(), float).reshape(3, 4))
    zeros = " ".join(["0"] * 12)
    (tmp_path / "c.txt").write_text(NEW.replace(f"P0: {P}", f"P0: {zeros}"))
    assert not read_calibration(tmp_path / "c.txt").p0.any()


def test_odometry_and_raw_data(tmp_path):
    (tmp_path / "odometry.txt").write_text(f"{PROJECTIONS}Tr: {VELO}\n")
    calib = read_calibration(tmp_path / "odometry.txt")
    np.testing.assert_array_equal(calib.r0_rect, np.eye(3))
    np.testing.assert_array_equal(calib.tr_velo_to_cam, np.array(VELO.split(), float).reshape(3, 4))
    (tmp_path / "odometry.txt").write_text(f"{PROJECTIONS}R0_rect: {TURNED}\nTr: {VELO}\n")
    np.testing.assert_array_equal(read_calibration(tmp_path / "odometry.txt").r0_rect, np.eye(3))
    raw = f"P_rect_02: {P}\nR_rect_00: {EYE}\nTr_velo_to_cam: {VELO}\nS_rect_02: 1.2e3 3.4e2\n"
    (tmp_path / "raw.txt").write_text(raw)
    assert read_calibration(tmp_path / "raw.txt").size == (1200, 340)
    write_calibration(tmp_path / "again.txt", read_calibration(tmp_path / "raw.txt"))
    assert read_calibration(tmp_path / "again.txt").size == (1200, 340)


def test_notations_of_other_converters(tmp_path):
    """Homogeneous matrices, commas and brackets, a row of a matrix in a line, other cases."""
    p2, velo = (np.array(text.split(), float).reshape(3, 4) for text in (P, VELO))
    last = "0 0 0 1"
    texts = {
        "4x4": f"P2: {P} {last}\nR0_rect: 1 0 0 0 0 1 0 0 0 0 1 0 {last}\n"
        f"Tr_velo_to_cam: {VELO} {last}\n",
        "3x4": f"P2: {P}\nR0_rect: 1 0 0 0 0 1 0 0 0 0 1 0\nTr_velo_to_cam: {VELO}\n",
        "brackets": f"p2 = [{', '.join(P.split())}]\nr0_rect = [{EYE.replace(' ', ',')}]\n"
        f"tr_velo_to_cam = [{VELO.replace(' ', ',')}]\n",
        "rows": "\n".join(
            f"{name}:\n" + "\n".join(" ".join(map(str, row)) for row in matrix)
            for name, matrix in (("P2", p2), ("R0_rect", np.eye(3)), ("Tr_velo_to_cam", velo))
        ),
        "points": f"P2: {P}\nR0_rect:\n1.0 -.0 .0\n+.0 1. 0\n-.0 0 1\nTr_velo_to_cam: {VELO}\n",
        "zeros": f"P2: {P}\nR0_rect: {EYE}\nTr_velo_to_cam: {VELO}\nTr_imu_to_velo: {'0 ' * 12}",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        calib = read_calibration(tmp_path / name)
        np.testing.assert_array_equal(calib.p2, p2)
        np.testing.assert_array_equal(calib.r0_rect, np.eye(3))
        np.testing.assert_array_equal(calib.tr_velo_to_cam, velo)
        assert calib.tr_imu_to_velo is None
    (tmp_path / "k").write_text(texts["3x4"].replace(P, "700 0 600 0 700 170 0 0 1"))
    expected = [[700, 0, 600, 0], [0, 700, 170, 0], [0, 0, 1, 0]]
    np.testing.assert_array_equal(read_calibration(tmp_path / "k").p2, expected)


def test_a_principal_point_far_from_the_centre(capsys):
    note.cache_clear()
    camera = _camera(721.5377, 609.5593, 172.854)
    with pytest.raises(InputError, match=r"--image_size: .* is outside 375x1242: expected W"):
        image_size_of(camera, (375, 1242))
    with pytest.raises(InputError, match="S_rect_02: the principal point"):
        image_size_of(_camera(700, 600, 170, size=(340, 1200)))
    assert capsys.readouterr().err == ""
    for size in ((2484, 750), (600, 375)):
        assert image_size_of(camera, size) == size
        seen = f"(609.559, 172.854) of P2 is far from the centre of {size[0]}x{size[1]} pixels"
        assert seen in capsys.readouterr().err


def test_waymos_front_camera_is_number_0(tmp_path, capsys):
    side, velo = P.replace("700", "500"), "0 -1 0 0 0 0 -1 0 1 0 0 -1.5"
    lines = [f"P0: {P}", *(f"P{i}: {side}" for i in (1, 2, 3, 4)), f"R0_rect: {EYE}"]
    lines += [f"Tr_velo_to_cam_{i}: {VELO if i else velo}" for i in range(5)]
    (tmp_path / "c.txt").write_text("\n".join(lines))
    calib = read_calibration(tmp_path / "c.txt")
    np.testing.assert_array_equal(calib.p2.ravel(), np.array(P.split(), float))
    np.testing.assert_array_equal(calib.tr_velo_to_cam.ravel(), np.array(velo.split(), float))
    assert "c.txt: the camera is number 0 (P0, Tr_velo_to_cam_0)" in capsys.readouterr().err


def _camera(focal, cx, cy, size=None):
    p2 = np.array([[focal, 0, cx, 0], [0, focal, cy, 0], [0, 0, 1, 0.0]])
    return Calibration(p2=p2, r0_rect=np.eye(3), tr_velo_to_cam=np.eye(4)[:3], size=size)


@pytest.mark.parametrize(
    ("camera", "given", "size"),
    [
        (_camera(721.5377, 609.5593, 172.854), None, (1242, 375)),
        (_camera(360.76885, 304.77965, 86.427), None, (621, 188)),  # half the resolution
        (_camera(721.5377, 609.5593, 172.854), (1392, 512), (1392, 512)),
        (_camera(721.5377, 609.5593, 172.854, size=(1242, 370)), None, (1242, 370)),
        (_camera(718.0, 613.0, 180.0), None, (1242, 375)),  # near KITTI's
        (_camera(1000.0, 959.5, 540.2), None, (1919, 1080)),  # twice the principal point
        (_camera(721.5377, 640.0, 240.0), None, (1280, 480)),  # KITTI's lens, another sensor
    ],
)
def test_image_size(camera, given, size):
    assert image_size_of(camera, given) == size


def test_no_image_size():
    with pytest.raises(InputError, match="--image_size: the calibration says 1200x340, found 9x9"):
        image_size_of(_camera(700, 600, 170, size=(1200, 340)), (9, 9))
    with pytest.raises(InputError, match="is in no image: expected S_rect_02"):
        image_size_of(_camera(700, 0, 0))
    for text in ("1242", "0x375", "1242x-3", "axb", "99999x375"):
        with pytest.raises(InputError, match="--image_size: expected pixels such as 1242x375"):
            parse_image_size(text)
    assert parse_image_size("1242x375") == (1242, 375)


def _without(key):
    return "".join(line + "\n" for line in NEW.splitlines() if not line.startswith(key))


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (_without("P2"), None, "missing key P2"),
        (_without("R0"), None, "missing key R0_rect"),
        (_without("Tr_velo"), None, "missing key Tr_velo_to_cam"),
        ("", None, "missing key P2.*, found none"),
        (NEW.replace("P2", "P_2"), None, "missing key P2, .*, found P0, .*, P_2"),
        (NEW.replace("velo_to_cam", "velo_to_cam_1"), None, "missing .*, Tr_velo_to_cam_1$"),
        (
            NEW.replace("velo_to_cam", "velo_to_cam_0").replace(f"P0: {P}", "P0:" + 12 * " 0"),
            None,
            "P0: expected focal lengths",
        ),
        (
            "calib_time: 09-Jan-2012 13:57:47\n" + _without("Tr_velo"),
            None,
            "missing key Tr_velo_to_cam, .*; the raw data has two files: cat calib_cam_to_cam.txt",
        ),
        (NEW.replace(VELO, VELO + " 0 0 0 2"), 6, "expected 12 numbers, found 16"),
        (NEW.replace(EYE, "1 0 0 5 0 1 0 0 0 0 1 0"), 5, "R0_rect: expected 9 numbers, found 12"),
        (NEW.replace(EYE, EYE[:-2]), 5, "R0_rect: expected 9 numbers, found 8"),
        (NEW.replace(VELO, VELO + " 1"), 6, "expected 12 numbers, found 13"),
        (NEW.replace("-0.27", "x"), 6, "Tr_velo_to_cam: expected numbers"),
        (NEW.replace("-0.27", "nan"), 6, "expected finite numbers"),
        (NEW.replace("-0.27", "inf"), 6, "expected finite numbers"),
        (NEW + f"P2: {P}\n", 8, "P2 is there twice"),
        (NEW.replace(EYE, "2 0 0 0 1 0 0 0 1"), 5, "not a rotation"),
        (NEW.replace(EYE, "-1 0 0 0 1 0 0 0 1"), 5, "not a rotation"),
        (NEW.replace("700", "0"), 3, "expected focal lengths of 10 to 20000 pixels"),
        (NEW.replace("700", "1e5"), 3, "expected focal lengths of 10 to 20000 pixels"),
        (
            NEW.replace(P, P.replace(" 1 ", " 2 ")),
            3,
            "expected rows f 0 cx tx, 0 f cy ty, 0 0 1 tz",
        ),
        (NEW.replace(P, "9" + P[3:]), 3, "expected focal lengths"),
        (NEW.replace("-0.27", "-270"), 6, "expected an offset of at most 20 metres"),
        (NEW.replace("-0.27", "-0_27"), 6, "expected finite numbers"),
        (NEW.replace("-0.27", "1e308"), 6, "expected numbers of magnitude 1e.06 at most"),
        (NEW + "S_rect_02: 0 375\n", 8, "expected width and height of 1 to 20000 pixels"),
        (NEW + "S_rect_02: 1e6 375\n", 8, "expected width and height of 1 to 20000 pixels"),
    ],
)
def test_bad_files(tmp_path, text, line, message):
    path = tmp_path / "c.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_calibration(path)
    assert error.value.line == line
    assert str(error.value).startswith(str(path))


def test_not_text_and_not_a_file(tmp_path):
    (tmp_path / "c.txt").write_bytes(NEW.encode() + b"\xff\xfe")
    with pytest.raises(InputError, match=r"c\.txt:8: .*plain text.*0xff"):
        read_calibration(tmp_path / "c.txt")
    with pytest.raises(InputError, match="directory"):
        read_calibration(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        read_calibration(tmp_path / "absent.txt")


@pytest.mark.real
def test_real_calibrations(kitti_root):
    paths = sorted((kitti_root / "training" / "calib").glob("*.txt"))
    assert len(paths) == 21
    for path in paths:
        calib = read_calibration(path)
        level = calib.velo_to_level(np.array([[10.0, 0, 0]]))[0]
        # The Velodyne looks forward, about 0.3 m behind and 0.1 m above the camera.
        np.testing.assert_allclose(level, [9.7, 0.0, 0.0], atol=0.4)
