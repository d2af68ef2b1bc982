"""track.py and the library's Tracker, on a network of given outputs and on a real one."""

import csv
import dataclasses
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.small_weights import write_weights
from helpers.street import as_seen, drive

import track
from common import flags
from common.errors import InputError
from common.notes import note
from kitti.calibration import standard_mounting, write_calibration
from kitti.labels import read_results
from kitti.scans.point_arrays import as_points
from kitti.scans.scan_files import write_scan
from models.boxes.box_decoding import Detections
from pointtracknet import Tracker

SPEED = np.array([5.0, 0.0, 0.0])  # metres per frame: more than a car's length


class ScriptedNetwork:
    """Networks that find one car which moves by SPEED, with its exact displacement."""

    def __init__(self):
        box = SimpleNamespace(classes=("Car", "Van"))
        self.detector = SimpleNamespace(config=SimpleNamespace(box=box))

    def detect(self, points, t):
        box = np.array([[10.0, 0, 0, 4, 1.8, 1.5, 0]]) + np.pad(SPEED * t, (0, 4))
        count = min(len(points), 1)
        detections = Detections(box[:count], np.ones(count), np.ones(count, np.int32))
        return SimpleNamespace(
            points=box[:count, :3], foreground=np.ones(count), detections=detections
        )

    def displacement(self, previous, current):
        return np.tile(SPEED, (len(previous.points), 1))


def scan(t: int = 0, count: int = 400) -> np.ndarray:
    rng = np.random.default_rng(t)
    return rng.uniform((5, -5, -1.7, 0), (40, 5, 1, 1), (count, 4)).astype(np.float32)


def test_standard_mounting_is_kittis():
    calib = standard_mounting()
    np.testing.assert_allclose(calib.velo_to_level(np.zeros((1, 3)))[0], [-0.272, 0.004, 0.076])
    ahead = calib.velo_to_level(np.array([[10.0, 2.0, 1.0]]))[0]
    np.testing.assert_allclose(ahead, [10 - 0.272, 2.004, 1.076])


def test_the_height_of_the_scanner_leaves_the_road_where_it_is():
    road = np.array([[20.0, 3.0, -1.0]])  # below a scanner at 1 m
    expected = standard_mounting().velo_to_level(np.array([[20.0, 3.0, -1.73]]))
    np.testing.assert_allclose(standard_mounting(1.0).velo_to_level(road), expected)
    given = track.TrackConfig(Path("scans"), Path("out"), sensor_height=1.0)
    np.testing.assert_array_equal(
        track.mounting(given).tr_velo_to_cam, standard_mounting(1.0).tr_velo_to_cam
    )
    both = dataclasses.replace(given, calib=Path("calib.txt"))
    with pytest.raises(InputError, match="--sensor_height: expected without --calib"):
        track.mounting(both)


def test_one_call_per_scan_keeps_the_id_of_a_fast_car():
    tracker = Tracker(ScriptedNetwork())
    seen = [tracker.update(scan(t)) for t in range(4)]
    assert [tracks.ids.tolist() for tracks in seen] == [[0]] * 4
    assert seen[-1].types.tolist() == ["Van"]
    np.testing.assert_allclose(seen[-1].boxes[0, :3], 3 * SPEED + [10, 0, 0])


def test_a_frame_without_points_is_survived():
    tracker = Tracker(ScriptedNetwork())
    counts = [len(tracker.update(points)) for points in (scan(), scan()[:0], scan())]
    assert counts == [1, 0, 1]


def test_the_first_scan_out_of_view_is_noted(capsys):
    tracker = Tracker(ScriptedNetwork())
    for points in (scan(), scan()[:0], scan()[:, [2, 0, 1, 3]], -scan(), scan()):
        tracker.update(points)
    assert tracker.unseen == 2
    noted = "note: scan 2 of the tracker, from 0: none of its 400 points lies in the camera's view"
    assert [line.partition(": expected")[0] for line in capsys.readouterr().err.splitlines()] == [
        noted
    ]


@pytest.mark.parametrize(
    "size", [(0, 0), (-5, 3), (10**9, 375), (1242.0, 375), (1242,), "1242x375"]
)
def test_a_bad_image_size_is_refused(size):
    with pytest.raises(InputError, match="image_size: expected width and height from 1 to 20000"):
        Tracker(ScriptedNetwork(), image_size=size)


def test_a_calibration_may_be_a_path(tmp_path):
    write_calibration(tmp_path / "c.txt", standard_mounting())
    for path in (tmp_path / "c.txt", str(tmp_path / "c.txt")):
        calib = Tracker(ScriptedNetwork(), path).calib
        np.testing.assert_allclose(calib.level_from_velo, standard_mounting().level_from_velo)
    with pytest.raises(InputError, match=r"none\.txt: cannot be read"):
        Tracker(ScriptedNetwork(), tmp_path / "none.txt")


@pytest.mark.parametrize("threshold", [float("nan"), float("-inf"), 50.0])
def test_a_score_threshold_that_no_box_can_reach_is_refused(threshold):
    with pytest.raises(InputError, match=r"score_threshold: expected a finite number, at most 1"):
        Tracker.load("nowhere", score_threshold=threshold)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((4, 2)), "shape"),
        (np.full((4, 4), np.nan), "finite"),
        (np.zeros((4, 40)), "transpose it"),
        (np.full((4, 4), 1e30), "expected metres, found 4 of 4 points beyond 1000 m"),
        (np.zeros(3, [("x", "f4"), ("y", "f4")]), "expected fields x, y, z .*found x, y"),
        (np.array([["a", "b", "c"]]), "real numbers"),
        ([[1, 2, 3], [4]], "expected an array of points"),
        (None, "real numbers"),
    ],
)
def test_bad_points_are_refused(points, message):
    with pytest.raises(InputError, match=message):
        Tracker(ScriptedNetwork()).update(points)


def as_structured(points: np.ndarray) -> np.ndarray:
    fields = ["intensity", "z", "y", "x"]
    array = np.zeros(len(points), [(name, "f8") for name in fields])
    for name, column in zip(fields, points.T[::-1], strict=True):
        array[name] = column
    return array


def with_no_returns(points: np.ndarray) -> np.ndarray:
    bad = [[np.nan] * 4, [5, np.inf, 0, 0], [1e30, 0, 0, 0.5]]
    return np.insert(points.astype(np.float64), 7, bad, axis=0)


@pytest.mark.parametrize(
    ("change", "dropped"),
    [
        (lambda points: points.astype(np.float64), 0),
        (lambda points: points.tolist(), 0),
        (lambda points: points.reshape(20, 20, 4), 0),
        (as_structured, 0),
        (lambda points: as_structured(points).reshape(20, 20), 0),
        (with_no_returns, 3),
        (lambda points: points * [1, 1, 1, np.nan], 0),
    ],
)
def test_a_scan_may_be_held_in_any_array(change, dropped):
    points, found = as_points(change(scan()))
    assert (points.dtype, found) == (np.float32, dropped)
    np.testing.assert_array_equal(points[:, :3], scan()[:, :3])


def test_a_refused_scan_leaves_the_tracker_as_it_was():
    tracker = Tracker(ScriptedNetwork())
    tracker.update(scan(0))
    with pytest.raises(InputError):
        tracker.update(np.full((5, 4), 1e30))
    tracks = tracker.update(np.vstack([scan(1), [[1e30, 0, 0, 0]]]))
    assert (tracks.ids.tolist(), tracker.dropped, tracker.frame) == ([0], 1, 2)


def test_frame_numbers_come_from_six_digits_or_from_the_order(tmp_path):
    for name in ("000007", "000009"):
        write_scan(tmp_path / f"{name}.bin", scan())
    scans = track.Scans(tmp_path)
    assert list(scans.files) == [7, 9]
    write_scan(tmp_path / "1317617735.bin", scan())
    assert list(track.Scans(tmp_path).files) == [0, 1, 2]
    results = track.track_scans(Tracker(ScriptedNetwork()), scans)
    assert list(scans.remarks()) == ["1 of 3 frames have no scan (gaps in the numbers)"]
    assert results.frame.tolist() == [7, 9]  # 8 has no scan: nothing is found there
    assert (results.bbox[:, 2] > results.bbox[:, 0]).all()


@pytest.mark.slow
def test_command_line_writes_results_and_pictures(tmp_path, capsys):
    weights = write_weights(tmp_path / "weights")
    for t in range(3):
        write_scan(tmp_path / "drive" / f"{t:06d}.bin", scan(t))
    write_scan(tmp_path / "drive" / "000003.bin", scan(3) * [-1, 1, 1, 1])  # behind the camera
    write_calibration(tmp_path / "calib.txt", standard_mounting())
    argv = ["--scans", tmp_path / "drive", "--weights", weights, "--calib", tmp_path / "calib.txt"]
    argv += ["--out", tmp_path / "out", "--format", "kitti,csv,jsonl", "--animation_frames", 2]
    assert flags.run(track.main, [str(a) for a in argv]) == 0
    printed, remarks = capsys.readouterr()
    assert "camera: 1242 x 375 pixels (KITTI's camera)" in printed
    assert "the first 2 of 4 frames; --animation_frames 0: all" in remarks
    assert "scan 3 of the tracker, from 0: none of its 400 points lies in the" in remarks
    results = read_results(tmp_path / "out" / "drive.txt", 4)
    rows = [json.loads(line) for line in (tmp_path / "out" / "drive.jsonl").open()]
    table = list(csv.DictReader((tmp_path / "out" / "drive.csv").open()))
    assert [int(row["id"]) for row in table] == [row["id"] for row in rows]
    assert [row["frame"] for row in rows] == results.frame.tolist()
    np.testing.assert_allclose([row["length"] for row in rows], results.boxes[:, 3], atol=1e-5)
    for name in ("drive.txt", "birds_eye.png", "trajectories.png", "animation.gif", "scene.html"):
        assert (tmp_path / "out" / name).is_file() and str(tmp_path / "out" / name) in printed
    page = (tmp_path / "out" / "scene.html").read_text(encoding="utf-8")
    assert '"shading":"foreground probability"' in page


def test_settings_from_a_file(tmp_path):
    file = tmp_path / "track.json"
    file.write_text(json.dumps({"scans": "DIR", "out": "here", "scan_scale": 0.5}))
    config = track.parse_config(["--config", str(file), "--out", "there"])
    assert config == track.TrackConfig(Path("DIR"), Path("there"), scan_scale=0.5)
    with pytest.raises(InputError, match="--scans, --out: required"):
        track.parse_config([])


def test_seen_are_the_input_points_of_the_detector():
    network = ScriptedNetwork()
    tracker = Tracker(network)
    assert tracker.seen.shape == (0, 4)
    sampled, probability = scan()[:, :3], scan()[:, 3]
    found = network.detect(scan(), 0)
    found.sampled, found.probability = sampled, probability
    network.detect = lambda points, t: found
    tracker.update(scan())
    np.testing.assert_array_equal(tracker.seen, scan())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda folder: None, "expected a directory with .bin files"),
        (lambda folder: folder.mkdir(), "found no .bin file"),
        (
            lambda folder: write_scan(folder / "a.bin", scan()),
            "detector.npz: expected a checkpoint",
        ),
        (lambda folder: write_scan(folder / "0.bin", scan()[:, [1, 0, 2, 3]]), "points lie in the"),
    ],
)
def test_bad_input_is_one_line(tmp_path, capsys, make, message):
    make(tmp_path / "scans")
    argv = ["--scans", tmp_path / "scans", "--out", tmp_path / "out", "--weights", tmp_path / "no"]
    assert flags.run(track.main, [str(a) for a in argv]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and message in error


def test_a_calibration_without_an_image_is_named(tmp_path, capsys):
    calib = standard_mounting()
    p2 = calib.p2 * [[1, 1, 0, 1], [1, 1, 0, 1], [1, 1, 1, 1]]
    write_calibration(tmp_path / "c.txt", replace(calib, p2=p2))
    write_scan(tmp_path / "scans" / "0.bin", scan())
    argv = ["--scans", tmp_path / "scans", "--out", tmp_path / "out", "--calib", tmp_path / "c.txt"]
    assert flags.run(track.main, [str(a) for a in argv]) == 2
    assert (
        f"error: {tmp_path / 'c.txt'}: the principal point (0, 0) of P2" in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("ahead", "flag"), [("y", "--scan_columns -y,x,z,i"), ("-y", "--scan_columns y,-x,z,i")]
)
def test_a_full_turn_with_another_axis_ahead_is_refused_and_then_read(
    tmp_path, capsys, ahead, flag
):
    for t in range(3):
        points = np.pad(as_seen(drive(1.2 * t), ahead), ((0, 0), (0, 1)))
        write_scan(tmp_path / "scans" / f"{t}.bin", points)
    argv = ["--scans", tmp_path / "scans", "--out", tmp_path / "out", "--weights", tmp_path / "no"]
    argv = [str(word) for word in argv]
    assert flags.run(track.main, argv) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"move along {ahead} from scan to scan" in error
    assert flag in error and not (tmp_path / "out").exists()
    columns = track.parse_columns(flag.split()[1])
    scans = track.Scans(tmp_path / "scans", track.ScanLayout(columns))
    np.testing.assert_allclose(scans.points(0)[:, :3], drive(0.0), atol=1e-5)
    for t in (1, 2):
        (tmp_path / "scans" / f"{t}.bin").unlink()
    note.cache_clear()
    assert flags.run(track.main, argv) == 2  # a single scan does not move
    assert "the scene is wider than long" in capsys.readouterr().err
    assert flags.run(track.main, [*argv, *flag.split()]) == 2
    assert capsys.readouterr().err.endswith("writes it\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("columns", "ahead", "right_handed", "left_handed"),
    [
        (None, "y", "-y,x,z,i", "y,x,z,i"),
        (None, "-y", "y,-x,z,i", "-y,-x,z,i"),
        (None, "-x", "-x,-y,z,i", "-x,y,z,i"),
        ("y,-x,z,i,ring", "-x", "-y,x,z,i,ring", "y,x,z,i,ring"),  # those of the other way round
    ],
)
def test_the_axes_of_a_scan_are_named_by_its_columns(columns, ahead, right_handed, left_handed):
    given = None if columns is None else track.parse_columns(columns)
    renamed = [track._renamed(given, axes) for axes in track.AXES_AHEAD[ahead]]
    assert renamed == [right_handed, left_handed]
