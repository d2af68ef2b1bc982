"""Damaged files of every kind: a door is a function of a folder and a random generator."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from helpers.small_files import ply

from campaigns.mutations import damaged, damaged_points, nasty_word
from common.config import from_dict, parse_json, to_dict
from common.steps import Steps
from kitti.calibration import read_calibration, standard_mounting, write_calibration
from kitti.camera_view import check_view, image_size_of
from kitti.detections import read_detection_folder
from kitti.labels import read_labels, read_results, write_results
from kitti.scans.heading import axis_ahead
from kitti.scans.point_arrays import as_points
from kitti.scans.scan_files import read_points, write_scan
from kitti.scans.scan_folder import find_scans
from kitti.scans.scan_layout import ScanLayout
from kitti.seqmap import read_seqmap
from kitti.sequence import KittiSequence
from models.config import DetectorConfig, TrackerConfig
from training.config import DetectorTrainingConfig, TrackerTrainingConfig

LABELS = "".join(
    f"{t} {i} {kind} 0 1 -1.5 100.0 120.0 200.0 180.0 1.5 1.6 4.0 2.0 1.7 2{i}.0 0.300000\n"
    for t in range(4)
    for i, kind in ((0, "Car"), (1, "Van"), (-1, "DontCare"))
).encode()
RESULTS = LABELS.replace(b"\n", b" 0.5\n").replace(b"-1 DontCare", b"7 Cyclist")
DETECTIONS = b"0,2,100,120,200,180,5.5,1.5,1.6,4.0,2.0,1.7,20.0,0.3,-1.5\n" * 3
OBJECT_ROW = b"Car 0 0 -1.5 100 120 200 180 1.5 1.6 4.0 2.0 1.7 20.0 0.3 0.9\n" * 2
SEQMAP = b"0000 empty 000000 000004\n0001 empty 000077 000153\n"
POSE = b"1 0 0 0 0 1 0 0 0 0 1 0\n"


def write_damaged(path: Path, data: bytes, rng: np.random.Generator) -> Path:
    """Writes `data` to `path` after some damage; returns `path`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(damaged(data, rng))
    return path


def labels(folder: Path, rng: np.random.Generator) -> None:
    """Label files."""
    read_labels(write_damaged(folder / "0000.txt", LABELS, rng))


def results(folder: Path, rng: np.random.Generator) -> None:
    """Result files: accepted rows survive writing and reading."""
    rows = read_results(write_damaged(folder / "0000.txt", RESULTS, rng))
    if np.isfinite(rows.score).all():
        write_results(folder / "again.txt", rows)
        assert len(read_results(folder / "again.txt")) == len(rows)


def detections(folder: Path, rng: np.random.Generator) -> None:
    """Detections, a file per sequence or per frame."""
    if rng.random() < 0.5:
        write_damaged(folder / "0000.txt", DETECTIONS, rng)
    else:
        write_damaged(folder / "0000" / f"{rng.integers(0, 9):06d}.txt", OBJECT_ROW, rng)
    read_detection_folder(folder, "0000", 5)


def calibration(folder: Path, rng: np.random.Generator) -> None:
    """Calibrations, and the image size that follows."""
    write_calibration(folder / "good.txt", standard_mounting())
    calib = read_calibration(
        write_damaged(folder / "c.txt", (folder / "good.txt").read_bytes(), rng)
    )
    image_size_of(calib)


def sequence(folder: Path, rng: np.random.Generator) -> None:
    """A data set with a damaged seqmap, label file or poses."""
    parts = {
        "training/evaluate_tracking.seqmap.training": SEQMAP,
        "training/label_02/0000.txt": LABELS,
        "poses/0000.txt": POSE * 4,
    }
    hurt = list(parts)[rng.integers(len(parts))]
    for name, data in parts.items():
        write_damaged(folder / name, data, rng)
        if name != hurt:
            (folder / name).write_bytes(data)
    opened = KittiSequence(folder, 0)
    _ = opened.frames, opened.objects, opened.poses


def seqmap(folder: Path, rng: np.random.Generator) -> None:
    """Sequence maps."""
    read_seqmap(write_damaged(folder / "map", SEQMAP, rng))


@cache
def _clouds() -> dict[str, bytes]:
    """A small cloud in every format, by file name."""
    import tempfile

    from pypcd4 import Encoding, PointCloud

    rng = np.random.default_rng(0)
    points = rng.uniform((5, -10, -2, 0), (40, 10, 1, 1), (60, 4)).astype(np.float32)
    names = ("x", "y", "z", "intensity")
    fields = np.zeros(60, [(name, "f4") for name in names])
    for name, column in zip(names, points.T, strict=True):
        fields[name] = column
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        write_scan(root / "0.bin", points)
        np.save(root / "1.npy", points)
        np.save(root / "2.npy", fields)
        for i, form in ((3, "ascii"), (4, "binary_little_endian")):
            (root / f"{i}.ply").write_bytes(ply(fields, form))
        for i, encoding in enumerate(("ascii", "binary", "binary_compressed"), 5):
            cloud = PointCloud.from_points(points, names, (np.float32,) * 4)
            cloud.save(root / f"{i}.pcd", encoding=Encoding(encoding))
        return {path.name: path.read_bytes() for path in sorted(root.iterdir())}


def scans(folder: Path, rng: np.random.Generator) -> None:
    """Scans of every format, with and without a layout."""
    name, data = list(_clouds().items())[rng.integers(len(_clouds()))]
    columns = (None, None, ("x", "y", "z"), ("y", "-x", "z", "i", "ring"))[rng.integers(4)]
    layout = ScanLayout(columns, (None, None, "float64", "int16")[rng.integers(4)])
    points, _ = read_points(write_damaged(folder / name, data, rng), layout)
    assert points.dtype == np.float32 and points.shape[1] == 4
    assert np.isfinite(points[:, :3]).all()


def views(_folder: Path, rng: np.random.Generator) -> None:
    """Scans of any axes, and impossible ones, before a calibration; the way ahead is an axis."""
    points = [
        as_points(part)[0][:, :3] for part in (damaged_points(rng), damaged_points(rng, 3000))
    ]
    scans = [points[rng.integers(2)] @ np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2)]
    assert axis_ahead([(scans[0], scans[1])]) in (None, "x", "-x", "y", "-y")
    seen, total = check_view(scans, standard_mounting(), (1242, 375))
    assert seen <= total and (seen or not total)


def scan_names(folder: Path, rng: np.random.Generator) -> None:
    """Folders of files with odd names."""
    for _ in range(rng.integers(1, 6)):
        stem = damaged(b"%d" % rng.integers(0, 10 ** int(rng.integers(1, 18))), rng)
        name = stem.decode("ascii", "ignore").replace("/", "-").replace("\0", "-")[:100]
        (folder / f"{name}{('.bin', '.bin', '.PCD')[rng.integers(3)]}").touch()
    frames = list(find_scans(folder))
    assert frames == sorted(frames)


def configurations(folder: Path, rng: np.random.Generator) -> None:
    """Configurations as JSON."""
    kinds = (DetectorConfig, TrackerConfig, DetectorTrainingConfig, TrackerTrainingConfig)
    kind = kinds[rng.integers(len(kinds))]
    path = write_damaged(folder / "config.json", json.dumps(to_dict(kind())).encode(), rng)
    from_dict(kind, parse_json(path.read_bytes(), path), path)


def steps(folder: Path, rng: np.random.Generator) -> None:
    """The memory of finished steps: a spoilt one is begun anew."""
    write_damaged(folder / "steps.json", b'{"one": "abc", "two": "def"}', rng)
    Steps(folder).run("three", nasty_word(rng), [], lambda: None)


FILE_DOORS: tuple[Callable[[Path, np.random.Generator], None], ...] = (
    labels,
    results,
    detections,
    calibration,
    sequence,
    seqmap,
    scans,
    views,
    scan_names,
    configurations,
    steps,
)
