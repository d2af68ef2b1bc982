"""Scans of any layout and format: read where they are described, refused with a hint elsewhere."""

import re
import sys

import numpy as np
import pytest
from helpers.small_files import ply
from pypcd4 import Encoding, PointCloud

from common.errors import InputError
from kitti.scans.scan_files import read_points, write_scan
from kitti.scans.scan_layout import ScanLayout, parse_columns

NAMES = ("x", "y", "z", "intensity")
ASCII = b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nPOINTS 2\nDATA ascii\n"
PLY = b"ply\nformat ascii 1.0\nelement vertex 2\n"
PLY += b"property float x\nproperty float y\nproperty float z\nend_header\n"


def cloud(count: int = 1200) -> np.ndarray:
    """(n, 4) float32: a flat scene around the scanner, in the order that a scanner measures."""
    rng = np.random.default_rng(0)
    angle, away = np.linspace(-3, 3, count), rng.gamma(3, 6, count)
    x, y, z = away * np.cos(angle), away * np.sin(angle), rng.normal(-1, 0.6, count)
    return np.column_stack([x, y, z, rng.uniform(0, 1, count)]).astype(np.float32)


def ring(count: int = 1200) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 64, count)


def times(count: int = 1200) -> np.ndarray:
    return np.linspace(0, 0.1, count)


def normals(count: int = 1200) -> np.ndarray:
    found = np.random.default_rng(2).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def pcl() -> np.ndarray:
    """(n, 8) float32: x, y, z, 1, intensity, 0, 0, 0, as PCL's PointXYZI lies in memory."""
    return np.insert(np.pad(cloud(), ((0, 0), (0, 3))), 3, 1.0, axis=1).astype(np.float32)


@pytest.mark.parametrize(
    ("numbers", "columns", "dtype"),
    [
        (cloud()[:, :3], "x,y,z", "float32"),
        (np.column_stack([cloud(), ring()]).astype("f4"), "x,y,z,i,ring", "float32"),
        (cloud().astype("f8"), "x,y,z,i", "float64"),
        (cloud()[:, :3].astype("f8"), "x,y,z", "float64"),
        (pcl(), "x,y,z,_,i,_,_,_", "float32"),
        (cloud().astype(">f4"), "x,y,z,i", ">f4"),
        (cloud().astype(">f8"), "x,y,z,i", ">f8"),
        (cloud()[:, [3, 0, 1, 2]], "i,x,y,z", "float32"),
        (np.column_stack([cloud(), times()]).astype("f4"), "x,y,z,i,t", "float32"),
        (np.column_stack([cloud(), ring(), times()]).astype("f4"), "x,y,z,i,ring,t", "float32"),
        (np.column_stack([cloud(), times(), ring()]).astype("f4"), "x,y,z,i,t,ring", "float32"),
        (np.column_stack([times(), cloud()]).astype("f4"), "t,x,y,z,i", "float32"),
        (np.column_stack([cloud(), ring(), -times()]).astype("f4"), "x,y,z,i,ring,t", "float32"),
        (np.column_stack([cloud()[:, :3], normals()]).astype("f4"), "x,y,z,a,b,c", "float32"),
        (cloud()[:, [3, 0, 1, 2]].astype("f4"), "i,x,y,z", "float32"),
        ((cloud() * [1, 1, 1, -30]).astype("f4"), "x,y,z,a", "float32"),  # decibels
        (np.column_stack([cloud(), cloud()[:, :3]]).astype("f4"), "x,y,z,a,b,c,d", "float32"),
        (np.column_stack([cloud()[:, :3], times() + 1.5e9]).astype("f8"), "x,y,z,a", "float64"),
    ],
)
def test_another_layout_is_named_and_then_read(tmp_path, numbers, columns, dtype):
    for count in (1200, 1197):
        path = tmp_path / "0.bin"
        path.write_bytes(numbers[:count].tobytes())
        reads = f"track.py reads it with --scan_columns {columns} --scan_dtype {dtype}"
        hint = f"it looks like {dtype} {columns}: {reads}"
        if columns.startswith("x,y,"):
            hint += f" (where y is ahead: -y,x,{columns[4:]})"
        with pytest.raises(InputError, match=re.escape(hint)):
            read_points(path)
        points, dropped = read_points(path, ScanLayout(tuple(columns.split(",")), dtype))
        assert (points.dtype, dropped) == (np.float32, 0)
        np.testing.assert_array_equal(points[:, :3], cloud()[:count, :3])


@pytest.mark.parametrize(
    "fields", [[("i", "<f4"), ("ring", "<u2")], [("i", "u1"), ("ring", "u1")]], ids=str
)
def test_records_of_several_types_are_named_and_read_with_their_fields(tmp_path, fields):
    rows = np.zeros(1200, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), *fields])
    for axis, values in zip("xyz", cloud().T, strict=False):
        rows[axis] = values
    rows["ring"] = ring()
    path = tmp_path / "0.bin"
    path.write_bytes(rows.tobytes())
    seen = f"it looks like records of {rows.dtype.itemsize} bytes of several types"
    with pytest.raises(InputError, match=seen):
        read_points(path)
    np.save(tmp_path / "0.npy", np.fromfile(path, rows.dtype))
    np.testing.assert_array_equal(read_points(tmp_path / "0.npy")[0][:, :3], cloud()[:, :3])


@pytest.mark.filterwarnings("error")
def test_damaged_records_raise_no_warning(tmp_path):
    signalling = np.array([0x7FA00001], "<u4").tobytes()  # a NaN that a cast complains about
    (tmp_path / "0.bin").write_bytes((signalling * 4 + b"\0\0") * 7)
    with pytest.raises(InputError, match="expected a positive multiple of 16 bytes"):
        read_points(tmp_path / "0.bin")
    (tmp_path / "0.bin").write_bytes(b"")
    with pytest.raises(InputError, match="found 0 bytes: without the file the frame counts as"):
        read_points(tmp_path / "0.bin")


def test_points_of_a_map_are_refused(tmp_path):
    np.add(cloud(), [450_000, 5_400_000, 100, 0]).astype("f4").tofile(tmp_path / "0.bin")
    seen = r"found points around x = 4\d{5}, y = 5\.4e\+06; the scanner is the origin$"
    with pytest.raises(InputError, match=seen):
        read_points(tmp_path / "0.bin")
    np.save(tmp_path / "0.npy", np.add(cloud(), [2000, 0, 0, 0]))
    with pytest.raises(InputError, match="the scanner is the origin"):
        read_points(tmp_path / "0.npy")


def test_kittis_layout_is_read_with_any_intensity(tmp_path):
    for intensity in (np.zeros(1200), np.full(1200, np.nan), np.linspace(0, 255, 1200)):
        points = np.column_stack([cloud()[:, :3], intensity]).astype(np.float32)
        write_scan(tmp_path / "0.bin", points)
        np.testing.assert_array_equal(read_points(tmp_path / "0.bin")[0], points)


def test_millimetres_are_named_and_then_read(tmp_path):
    write_scan(tmp_path / "0.bin", cloud() * np.float32([1000, 1000, 1000, 1]))
    with pytest.raises(
        InputError, match=r"a median range of .*; track.py --scan_scale 0\.001 reads mill"
    ):
        read_points(tmp_path / "0.bin")
    write_scan(tmp_path / "1.bin", cloud() * np.float32([100, 100, 100, 1]))
    with pytest.raises(
        InputError, match=r"a median range of .*; track.py --scan_scale 0\.01 reads centi"
    ):
        read_points(tmp_path / "1.bin")
    points, _ = read_points(tmp_path / "0.bin", ScanLayout(scale=0.001))
    np.testing.assert_allclose(points, cloud(), rtol=1e-6)


def test_columns_are_named_in_any_case():
    assert parse_columns("X, Y, Z, Intensity") == ("x", "y", "z", "i")
    assert parse_columns("y,-x,z") == ("y", "-x", "z")


def test_axes_are_put_in_order(tmp_path):
    right_ahead_up = np.column_stack([-cloud()[:, 1], cloud()[:, 0], cloud()[:, 2]])
    right_ahead_up.astype("f4").tofile(tmp_path / "0.bin")
    layout = ScanLayout(("-y", "x", "z"))
    np.testing.assert_array_equal(read_points(tmp_path / "0.bin", layout)[0][:, :3], cloud()[:, :3])


def test_points_without_a_return_are_dropped_and_counted(tmp_path):
    points = cloud()
    points[5, 0], points[6, 1], points[7, 2] = np.nan, np.inf, 1e30
    write_scan(tmp_path / "0.bin", points)
    found, dropped = read_points(tmp_path / "0.bin")
    assert dropped == 3
    np.testing.assert_array_equal(found, np.delete(cloud(), (5, 6, 7), axis=0))
    write_scan(tmp_path / "0.bin", points[5:6])
    with pytest.raises(InputError, match=r"0\.bin: expected finite points, found none among 1"):
        read_points(tmp_path / "0.bin")


def _write(path, kind):
    structured = np.zeros(1200, [(name, "f4") for name in NAMES])
    for name, column in zip(NAMES, cloud().T, strict=True):
        structured[name] = column
    if kind == "npy":
        np.save(path, cloud())
    elif kind == "npy, structured":
        np.save(path, structured)
    elif kind == "npy, organised":
        np.save(path, cloud().reshape(30, 40, 4))
    elif kind in ("ply", "ply, ascii"):
        path.write_bytes(ply(structured, "ascii" if "ascii" in kind else "binary_little_endian"))
    else:
        points = PointCloud.from_points(cloud(), NAMES, (np.float32,) * 4)
        points.save(path, encoding=Encoding(kind.split(", ")[1]))


KINDS = (
    "npy",
    "npy, structured",
    "npy, organised",
    "ply",
    "ply, ascii",
    "pcd, ascii",
    "pcd, binary",
    "pcd, binary_compressed",
)


@pytest.mark.parametrize("kind", KINDS)
def test_formats(tmp_path, kind):
    path = tmp_path / f"0.{kind[:3]}"
    _write(path, kind)
    points, dropped = read_points(path)
    assert (points.dtype, dropped) == (np.float32, 0)
    np.testing.assert_allclose(points, cloud(), rtol=1e-5, atol=1e-5)
    turned, _ = read_points(path, ScanLayout(("y", "-x", "z", "i"), scale=2.0))
    np.testing.assert_allclose(
        turned[:, :2], 2 * cloud()[:, [1, 0]] * [-1, 1], rtol=1e-5, atol=1e-4
    )


@pytest.mark.parametrize(
    "change",
    [
        (b"COUNT 1 1 1 1\n", b""),
        (b"HEIGHT 1\n", b""),
        (b"POINTS 1200\n", b""),
        (b"VERSION 0.7\n", b"VERSION 0.5\n"),
        (b"VERSION", b"# caf\xc3\xa9\r\n\nVERSION"),
    ],
)
def test_pcd_with_other_headers(tmp_path, change):
    """Lines that PCL can do without, older versions, comments in any encoding."""
    for kind in KINDS[-3:]:
        _write(tmp_path / "0.pcd", kind)
        data = (tmp_path / "0.pcd").read_bytes()
        assert data.count(change[0])
        (tmp_path / "0.pcd").write_bytes(data.replace(*change, 1))
        points, _ = read_points(tmp_path / "0.pcd")
        np.testing.assert_allclose(points, cloud(), rtol=1e-5, atol=1e-5)


def test_pcd_with_other_white_space(tmp_path):
    _write(tmp_path / "0.pcd", "pcd, ascii")
    head, word, body = (tmp_path / "0.pcd").read_bytes().partition(b"ascii\n")
    body = body.replace(b" ", b" \t").replace(b"\n", b" \r\n")
    (tmp_path / "0.pcd").write_bytes(head + word + body)
    np.testing.assert_allclose(read_points(tmp_path / "0.pcd")[0], cloud(), rtol=1e-5, atol=1e-5)


def test_ply_of_other_number_types_and_elements(tmp_path):
    wide = np.zeros(2, [("x", ">f8"), ("y", ">f8"), ("z", ">f8"), ("intensity", "u1")])
    wide["x"], wide["y"], wide["z"], wide["intensity"] = (1, 2), (3, 4), (5, 6), (7, 8)
    fields = b"property double x\nproperty double y\nproperty float64 z\nproperty uchar intensity\n"
    head = b"ply\r\nformat binary_big_endian 1.0\r\nelement camera 3\nproperty short a\n"
    head += b"element vertex 2\n" + fields + b"end_header\r\n"
    (tmp_path / "0.ply").write_bytes(head + bytes(6) + wide.tobytes())
    points, _ = read_points(tmp_path / "0.ply")
    np.testing.assert_array_equal(points, [[1, 3, 5, 7], [2, 4, 6, 8]])


@pytest.mark.parametrize(
    ("name", "head", "body"),
    [
        ("0.pcd", ASCII, b"\n1 2 3\n\n4 nan 6\n4 5 6"),
        ("0.ply", PLY, b"\xef\xbb\xbf1 2 3\r\n\r\n4 5 6\r\n3 0 1 2\n"),
        ("0.ply", b"\xef\xbb\xbf" + PLY.replace(b"\n", b" \n"), b"1 2 3 \n4\t5 6"),
        (
            "0.ply",
            PLY.replace(b"element vertex", b"element camera 1\nproperty float a\nelement vertex"),
            b"9\n1 2 3\n4 5 6\n",
        ),
    ],
)
def test_texts_as_other_programs_write_them(tmp_path, name, head, body):
    """Blank lines, white space at the ends of lines, byte order marks, other elements."""
    head = head.replace(b"POINTS 2", b"POINTS 3").replace(b"WIDTH 2", b"WIDTH 3")
    (tmp_path / name).write_bytes(head + body)
    points, _ = read_points(tmp_path / name)
    np.testing.assert_array_equal(points, [[1, 2, 3, 0], [4, 5, 6, 0]])


@pytest.mark.parametrize("kind", KINDS)
def test_damage_is_one_line(tmp_path, kind):
    path = tmp_path / f"0.{kind[:3]}"
    _write(path, kind)
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    for _ in range(40):
        at, length = rng.integers(0, min(len(whole), 400)), rng.integers(0, 40)
        damaged = whole[:at] + rng.bytes(rng.integers(0, 40)) + whole[at + length :]
        path.write_bytes(damaged[: rng.integers(len(damaged) // 2, len(damaged) + 1)])
        try:
            points, _ = read_points(path)
        except InputError as error:
            assert str(error).startswith(str(path)) and "\n" not in str(error)
        else:
            assert np.isfinite(points[:, :3]).all()


def test_headers_in_other_cases_and_empty_clouds(tmp_path):
    fields = "FIELDS x y z\nSIZE 4 4 4\nTYPE f f f\nWIDTH 1\n"
    (tmp_path / "0.pcd").write_bytes(
        f"{fields}DATA BINARY\n".encode() + np.float32([5, 6, 7]).tobytes()
    )
    np.testing.assert_array_equal(read_points(tmp_path / "0.pcd")[0], [[5, 6, 7, 0]])
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    for form in ("ascii", "binary_little_endian"):
        text = f"ply\nformat {form} 1.0\nelement vertex 0\n{axes}end_header\n"
        (tmp_path / "0.ply").write_text(text)
        assert read_points(tmp_path / "0.ply")[0].shape == (0, 4)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("0.txt", b"1 2 3", "expected a scan ending in .bin, .npy, .pcd, .ply"),
        ("0.npy", b"\x93NUMPY", "not a whole .npy file"),
        ("0.bin", b"\x93NUMPY" + bytes(122), "expected raw float32 numbers, found a .npy file"),
        ("0.bin", b"\x1f\x8b" + bytes(30), "found a gzip file by another name"),
        ("0.bin", b"1.0 2.0 3.0 0.5\n" * 20, "found text: numpy.loadtxt"),
        ("0.bin", b"x,y,z,intensity\r\n1,2,3,0\r\n", "found text: numpy.loadtxt"),
        ("0.ply", b"obj\n", "expected a header from ply to end_header"),
        ("0.ply", b"ply\nelement vertex 0\nend_header\n", "expected a format"),
        ("0.ply", b"ply\nformat ascii 2.0\nend_header\n", "unknown line in the header"),
        ("0.ply", b"ply\nformat ascii 1.0\nend_header\n", "expected an element vertex"),
        (
            "0.ply",
            b"ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int a\n"
            b"element vertex 1\nproperty float x\nend_header\n1 2\n3\n",
            "expected the vertices before the lists of element face",
        ),
        (
            "0.ply",
            b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nend_header\n1\n",
            "2 points declared, 1 found",
        ),
        ("0.ply", b"ply\nformat ascii 1.0\nelement vertex 2000000000\nend_header\n", "declared"),
        (
            "0.pcd",
            ASCII.replace(b"SIZE 4 4 4", b"SIZE 4 4"),
            "SIZE: expected 3 words as in FIELDS, f",
        ),
        ("0.pcd", ASCII + b"1 2 3\n1,2,3\n", "line 9: expected 3 numbers, found 1"),
        ("0.pcd", ASCII + b"1 2 3\n\n1 2 x\n", "line 10: expected a number, found 'x'"),
        ("0.pcd", ASCII + b"1 2 3\n", "2 points declared, 1 found"),
        ("0.ply", PLY + b"1 2 3\n1 2 3 255\n", "line 9: expected 3 numbers, found 4"),
        ("0.ply", PLY + b"1 2 3\n1 2 3,0\n", "line 9: expected a number, found '3,0'"),
        (
            "0.ply",
            PLY.replace(b"ascii", b"binary_little_endian") + bytes(13),
            "2 points .* 1 found",
        ),
        (
            "0.ply",
            PLY.replace(b"float y", b"list int int y"),
            "expected no lists in element vertex",
        ),
        ("0.pcd", b"1 2 3\n4 5 6\n", "not a whole .pcd file: no line DATA"),
        ("0.pcd", b"VERSION .7\nFIELDS x y z\nDATA ascii\n", "no line SIZE"),
        (
            "0.pcd",
            b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2000000000\n"
            b"HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2000000000\n"
            b"DATA binary_compressed\n12345678",
            "2000000000 points declared",
        ),
    ],
)
def test_other_files_are_refused(tmp_path, name, data, message):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=message):
        read_points(tmp_path / name)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"columns": ("x", "y")}, "--scan_columns: expected x, y, z once"),
        ({"columns": ("x", "y", "z", "z")}, "--scan_columns: expected x, y, z once"),
        ({"dtype": "float33"}, "--scan_dtype: expected such as float32"),
        ({"dtype": "object"}, "--scan_dtype: expected such as float32"),
        ({"scale": 0.0}, "--scan_scale"),
    ],
)
def test_bad_layouts(fields, message):
    with pytest.raises(InputError, match=message):
        ScanLayout(**fields)


def test_a_reader_that_is_not_installed_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pypcd4", None)
    (tmp_path / "0.pcd").write_bytes(b"VERSION .7\n")
    with pytest.raises(InputError, match="needs the package pypcd4: pip install pypcd4"):
        read_points(tmp_path / "0.pcd")
