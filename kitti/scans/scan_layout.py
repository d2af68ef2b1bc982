"""Layout of a raw `.bin` scan: columns and number format; detects a wrong layout by the content.

A raw scan does not declare its layout. KITTI's is four little-endian float32: x, y, z in metres and
an intensity. Other files give implausible numbers in this layout; the error then names the layout
in which they are plausible.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.errors import InputError

KITTI_COLUMNS = ("x", "y", "z", "i")
_CANDIDATES = (  # those of most columns are preferred, since half of them may fit too
    ("x", "y", "z", "_", "i", "_", "_", "_"),  # PCL's PointXYZI in memory
    (*KITTI_COLUMNS, "ring", "t"),
    (*KITTI_COLUMNS, "t", "ring"),
    (*KITTI_COLUMNS, "ring"),
    (*KITTI_COLUMNS, "t"),
    ("t", *KITTI_COLUMNS),
    ("_", *KITTI_COLUMNS),  # the index of a batch
    KITTI_COLUMNS,
    ("x", "y", "z", "a"),
    ("i", "x", "y", "z"),
    ("x", "y", "z"),
)
# where none of these fits; anything may be in the last columns, so fewest first
_UNKNOWN = tuple(("x", "y", "z", *"abcdefg"[:more]) for more in range(1, 8))
_NAMES = {"<f4": "float32", "<f8": "float64", ">f4": ">f4", ">f8": ">f8", "<f2": "float16"}
_MAGIC = {
    b"\x93NUMPY": ".npy file",
    b"# .PCD": ".pcd file",
    b"ply\n": ".ply file",
    b"ply\r": ".ply file",
    b"PK\x03\x04": "zip archive",
    b"\x1f\x8b": "gzip file",
    b"LASF": "LAS file",
    b"\x89HDF": "HDF5 file",
}
_TEXT = re.compile(rb"[\t\n\r -~]{16,}")
_PROBED = 400  # bytes
_ORIGIN = "; the scanner is the origin"
_SCALE = "; track.py --scan_scale "
_DTYPE = re.compile(r"float(16|32|64)|u?int(8|16|32|64)|[<>]?(f[248]|[iu][1248])")
_MILLIMETRES = 4000.0  # the median range of a scan is between 4 and 40 metres
_FAR = 500.0  # metres; no automotive scanner measures farther
_MAX_INTENSITY = 65535.0
_RANGES = {"i": (0, _MAX_INTENSITY), "ring": (0, 255), "t": (-2e9, 2e9)}
"""Plausible numbers of a column; times may count back from the end of a turn."""
_STRAY = 0.01  # share of implausible numbers that a right layout may hold
_LOW = 1.0  # metres; less than the height of any scene, and as much as an intensity up to 1
_FEW = 10  # points; fewer do not tell
_ALIKE = 0.1  # least ratio of the spreads of every second point and of the others
_FLAT = 0.6  # ratio of the spread of heights to that along the wider horizontal axis


@dataclass(frozen=True)
class ScanLayout:
    """Columns, number format and unit of a raw scan.

    Attributes:
        columns: names in file order: x, y, z, i (intensity); others are ignored; "-y" negates the
            axis. None: the file's own, for .bin KITTI's x, y, z, i.
        dtype: of the numbers in .bin, such as float64; None: float32.
        scale: metres per unit of length.
    """

    columns: tuple[str, ...] | None = None
    dtype: str | None = None
    scale: float = 1.0

    def __post_init__(self):
        if self.columns is not None:
            bare = [name.removeprefix("-") for name in self.columns]
            if any(bare.count(axis) != 1 for axis in "xyz") or bare.count("i") > 1:
                found = ",".join(self.columns)
                raise InputError(f"--scan_columns: expected x, y, z once, like x,y,z,i: {found!r}")
        if self.dtype is not None and _DTYPE.fullmatch(self.dtype) is None:
            raise InputError(
                f"--scan_dtype: expected such as float32, float64, int16, >f4, found {self.dtype!r}"
            )
        if not 0 < self.scale < np.inf:
            raise InputError(f"--scan_scale: expected metres above 0, found {self.scale}")


KITTI_LAYOUT = ScanLayout()


def parse_columns(text: str) -> tuple[str, ...]:
    """ "X, Y, Z, intensity" -> ("x", "y", "z", "i")."""
    names = (name.strip().lower() for name in text.split(","))
    return tuple("i" if name == "intensity" else name for name in names)


def raw_points(data: bytes, layout: ScanLayout, path: str | Path, flags: bool) -> np.ndarray:
    """The bytes of a `.bin` scan as (n, >= 3): x, y, z in metres, and an intensity if it has one.

    Errors name the flags of track.py that read other layouts, if `flags`.

    Raises:
        InputError: not a whole number of points, or numbers that are implausible in KITTI's
            layout, where none is given.
    """
    columns = layout.columns or KITTI_COLUMNS
    dtype = np.dtype(layout.dtype or np.float32)
    if dtype.byteorder != ">":
        dtype = dtype.newbyteorder("<")
    size = dtype.itemsize * len(columns)
    given = layout.columns is not None or layout.dtype is not None
    magic = "" if given else next((_MAGIC[key] for key in _MAGIC if data.startswith(key)), "")
    if not given and _TEXT.fullmatch(data[:_PROBED]):
        expected = "expected raw float32 numbers, found text"
        way = 'numpy.loadtxt(FILE).astype("float32").tofile("000000.bin") converts it'
        raise InputError(f"{expected}: {way}", path)
    if magic:
        raise InputError(f"expected raw float32 numbers, found a {magic} by another name", path)
    if not data:
        way = "without the file the frame counts as one without a scan"
        raise InputError(f"expected points, found 0 bytes: {way}", path)
    if len(data) % size:
        hint = "" if given else _hint(data, flags)
        raise InputError(
            f"expected a positive multiple of {size} bytes, found {len(data)} "
            f"({dtype.name} {','.join(columns)}){hint}",
            path,
        )
    numbers = np.frombuffer(data, dtype).reshape(-1, len(columns))
    points = named_columns(numbers, columns, layout.scale)
    seen = "" if given else _implausible(points)
    if seen:
        hint = "" if _SCALE in seen or _ORIGIN in seen else _hint(data, flags)
        if not flags:
            seen = seen.partition(_SCALE)[0]
        expected = "expected float32 x,y,z in metres and an intensity"
        raise InputError(f"{expected}, found {seen}{hint}", path)
    return points


def named_columns(numbers: np.ndarray, columns: tuple[str, ...], scale: float = 1.0) -> np.ndarray:
    """(n, C) numbers -> (n, 3 or 4) x, y, z (times `scale`) and intensity, by column names."""
    bare = [name.removeprefix("-") for name in columns]
    wanted = [*"xyz", *("i" for name in bare if name == "i")]
    points = np.stack([numbers[:, bare.index(name)] for name in wanted], axis=1)
    turned = [axis for axis, name in enumerate("xyz") if f"-{name}" in columns]
    if turned or scale != 1.0:
        with np.errstate(all="ignore"):
            points = points.astype(np.float64)
            points[:, turned] *= -1.0
            points[:, :3] *= scale
    return points


def _implausible(numbers: np.ndarray) -> str:
    """The fault of (n, 4) numbers as x, y, z in metres and intensity; "" if plausible."""
    xyz, intensity = numbers[:, :3], numbers[:, 3]
    padded = (xyz[:, 0] != 0) & (xyz[:, 1:] == 0).all(axis=1)
    if padded.sum() > 20 and padded.mean() > _STRAY:
        return f"{padded.mean():.0%} of the points at y = z = 0"
    if -_FAR <= xyz.min() <= xyz.max() <= _FAR and 0 <= intensity.min() <= intensity.max() <= 255:
        return ""
    with np.errstate(invalid="ignore"):
        size = np.abs(xyz)
        elsewhere = _elsewhere(xyz[np.isfinite(size).all(axis=1)])
        if elsewhere:
            return elsewhere
        strange = np.isfinite(xyz) & ((size > 1e6) | ((size > 0) & (size < 1e-12)))
        if strange.mean() > _STRAY:
            return f"{strange.mean():.0%} of the coordinates below 1e-12 or above 1e6"
        far = np.isfinite(size).all(axis=1) & (size > _FAR).any(axis=1)
        if far.mean() > 0.5:
            middle = np.median(np.linalg.norm(xyz[far], axis=1))
            unit = "0.001 reads millimetres" if middle > _MILLIMETRES else "0.01 reads centimetres"
            return f"a median range of {middle:.4g}{_SCALE}{unit}"
        known = np.isfinite(intensity)
        outside = known & ((intensity < 0) | (intensity > _MAX_INTENSITY))
    if outside.mean() > _STRAY:
        return (
            f"intensities from {intensity[known].min():.4g} to {intensity[known].max():.4g} "
            f"({outside.mean():.0%} outside 0 to {_MAX_INTENSITY:.0f})"
        )
    return ""


def _elsewhere(xyz: np.ndarray) -> str:
    """The fault of (n, 3) points that are far from the scanner, all to one side, as in a map."""
    if not len(xyz):
        return ""
    low, middle, high = np.percentile(xyz[:, :2].astype(np.float64), (5, 50, 95), axis=0)
    if np.hypot(*middle) < max(_FAR, *(high - low)):
        return ""
    return f"points around x = {middle[0]:.6g}, y = {middle[1]:.6g}{_ORIGIN}"


def _hint(data: bytes, flags: bool) -> str:
    """A plausible layout, for the error message, with track.py's flags for it if `flags`."""
    found = _plausible(data, _CANDIDATES)
    if not found and (size := _record_size(data)):
        fields = "numpy.save of numpy.fromfile(FILE, DTYPE) with fields x, y, z, intensity"
        return f"; it looks like records of {size} bytes of several types: {fields} is read"
    found = found or _plausible(data, _UNKNOWN)
    if not found:
        return "; --scan_columns and --scan_dtype of track.py read other layouts" if flags else ""
    *_, dtype, columns = min(found)
    looks = f"; it looks like {dtype} {columns}"
    if not flags:
        return looks
    reads = f"track.py reads it with --scan_columns {columns} --scan_dtype {dtype}"
    if columns.startswith("x,y,"):
        reads += f" (where y is ahead: {columns.replace('x,y,', '-y,x,', 1)})"
    return f"{looks}: {reads}"


def _record_size(data: bytes) -> int | None:
    """Bytes of a packed record that begins with float32 x, y, z and is no multiple of a float32."""
    for size in range(13, 32):
        if size % 4 and len(data) % size == 0:
            record = np.dtype({"names": ["xyz"], "formats": ["<3f4"], "itemsize": size})
            xyz = np.frombuffer(data, record)["xyz"]
            with np.errstate(all="ignore"):
                if _flatness(xyz.astype(np.float64), ("x", "y", "z")) < _FLAT:
                    return size
    return None


def _plausible(data: bytes, candidates: Iterable[tuple[str, ...]]) -> list[tuple]:
    """The candidates in which the scan is plausible; the least tuple is the best."""
    found = []
    for dtype, name in _NAMES.items():
        for rank, columns in enumerate(candidates):
            if len(data) % (np.dtype(dtype).itemsize * len(columns)) == 0:
                numbers = np.frombuffer(data, dtype).reshape(-1, len(columns))
                with np.errstate(all="ignore"):
                    flatness = _flatness(numbers.astype(np.float64), columns)
                if flatness < _FLAT:
                    order = (-len(columns), round(flatness, 2), rank)
                    found.append((*order, name, ",".join(columns)))
    return found


def _flatness(numbers: np.ndarray, columns: tuple[str, ...]) -> float:
    """Spread of z over that of x or y; infinity for an implausible scan."""
    xyz = numbers[:, [columns.index(axis) for axis in "xyz"]]
    numbers, xyz = (part[np.isfinite(xyz).all(axis=1)] for part in (numbers, xyz))
    if not len(numbers):
        return np.inf
    size = np.abs(xyz)
    strange = (size > _FAR) | ((size > 0) & (size < 1e-12))
    for column, name in zip(numbers.T, columns, strict=True):
        least, most = _RANGES.get(name, (-np.inf, np.inf))
        if ((column < least) | (column > most)).mean() > _STRAY:
            return np.inf
        if name == "ring" and (column != np.rint(column)).any():
            return np.inf
        if name == "_" and np.ptp(column) > 0:
            return np.inf
    if _alternate(xyz):
        return np.inf
    low, high = np.percentile(xyz, (5, 95), axis=0)
    width, height = max(high[:2] - low[:2]), high[2] - low[2]
    return height / width if height > _LOW and strange.mean() <= _STRAY else np.inf


def _alternate(xyz: np.ndarray) -> bool:
    """True if every second row is of another kind: rows of twice as many columns, cut in two."""
    halves = [half for half in (xyz[::2], xyz[1::2]) if len(half) >= _FEW]
    if len(halves) < 2:
        return False
    whole = [bool((half == np.rint(half)).all(axis=0).any()) for half in halves]
    spreads = [np.ptp(np.percentile(half[:, :2], (5, 95), axis=0), axis=0).max() for half in halves]
    return whole[0] != whole[1] or min(spreads) < _ALIKE * max(spreads)
