"""The scene's data: packed values equal the input; errors equal those of evaluate.py."""

import base64
import json
import re

import numpy as np
import pytest
from helpers.html_check import check

from kitti.objects import Objects
from metrics.protocols import Entry, evaluate_protocol
from visualization.clip import Clip
from visualization.scene import (
    FALSE_ALARM,
    NOT_EVALUATED,
    SWITCH,
    scene_data,
    speeds,
    tracks_of,
)
from visualization.scene_page import deck_gl, scene_page, write_scene
from visualization.scene_points import FOREGROUND, STEP, ScenePoints, pack_points, thin

FRAMES = 5
SIZES = {"int8": 1, "uint8": 1, "int32": 4, "float32": 4}


def unpack(packed) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["data"]), packed["type"])


def drive(ids, shift=0.0, frames=FRAMES, kind="Car") -> Objects:
    """A car per id, side by side, 0.8 m a frame."""
    parts = []
    for t in range(frames):
        boxes = np.tile([10 + 0.8 * t + shift, 0, -1, 4, 1.8, 1.5, 0.1], (len(ids), 1))
        boxes[:, 1] = 5 * np.arange(len(ids))
        parts.append(Objects.from_boxes(t, np.array(ids), boxes, 0.7, kind=kind))
    return Objects.concatenate(parts)


def points(t: int) -> np.ndarray | None:
    rng = np.random.default_rng(t)
    xyz = rng.uniform((0, -20, -2), (60, 20, 1), (300, 3))
    return None if t == 2 else np.column_stack([xyz, rng.random(300)]).astype(np.float32)


@pytest.fixture
def clip() -> Clip:
    return Clip("0016", range(FRAMES), points, Objects.empty(), drive([3, 4]))


def test_boxes_ids_and_scores_are_those_of_the_results(clip):
    results = drive([7, 2**40], 0.3)
    (packed,) = scene_data(clip, {"ours": results})["trackers"]
    np.testing.assert_array_equal(unpack(packed["frame"]), results.frame)
    np.testing.assert_array_equal(unpack(packed["box"]), results.boxes.ravel().astype("f4"))
    np.testing.assert_array_equal(unpack(packed["score"]), results.score.astype("f4"))
    ids = [packed["ids"][i] for i in unpack(packed["track"])]
    assert ids == [str(i) for i in results.track_id.tolist()]
    assert [packed["types"][i] for i in unpack(packed["type"])] == results.type.tolist()
    assert len(packed["colors"]) == len(packed["ids"]) == 2


def test_a_half_sequence_counts_from_its_first_frame():
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 0, 3] = np.arange(FRAMES)
    cars = drive([3])
    later = cars[cars.frame >= 3]
    whole = scene_data(Clip("0016", range(FRAMES), points, later, cars, poses), {"ours": cars})
    half = scene_data(Clip("0016", range(3, FRAMES), points, later, later, poses), {"ours": later})
    assert (half["first"], half["frames"]) == (3, 2)
    assert unpack(half["trackers"][0]["frame"]).tolist() == [0, 1]
    assert unpack(half["trackers"][0]["errors"][0]).tolist() == [0, 0]
    assert half["points"]["frames"] == whole["points"]["frames"][3:]
    assert unpack(half["poses"]).tolist() == unpack(whole["poses"])[3 * 16 :].tolist()


def test_points_are_rounded_to_a_step(clip):
    scan = np.array([[1.234, -5.678, 0.5, 0.0], [327.0, 0, 0, 1.0], [400.0, 0, 0, 1.0]])
    data = base64.b64decode(pack_points(scan))
    assert len(data) == 7 * 2  # points beyond 327 m are omitted
    xyz = np.frombuffer(data[:12], "<i2").reshape(2, 3) * STEP
    np.testing.assert_allclose(xyz, scan[:2, :3], atol=STEP / 2 + 1e-9)
    assert list(data[12:]) == [0, 255]


def test_points_are_thinned_and_the_page_says_so(clip):
    data = scene_data(clip, {}, points_per_frame=100)
    counts = [len(base64.b64decode(frame)) / 7 for frame in data["points"]["frames"]]
    assert counts == [100, 100, 0, 100, 100]
    assert any("100 of up to 300, drawn at random" in note for note in data["notes"])
    scan = points(0)
    kept = {tuple(row) for row in thin(scan, 100, 0).tolist()}
    assert len(kept) == 100 and kept <= {tuple(row) for row in scan.tolist()}


def test_errors_are_those_of_the_evaluation(clip):
    """Car 4 is lost in frames 2 and 3 and comes back as 9; 50 is nowhere; a cyclist is no car."""
    good, other = drive([3, 4], 0.1), drive([3, 9], 0.1)
    alarm = Objects.from_boxes(1, 50, np.array([[40.0, 9, 0, 4, 2, 1.5, 0]]), 0.5)
    cyclist = Objects.from_boxes(0, 60, np.array([[30.0, 9, 0, 2, 1, 1.5, 0]]), 0.5, kind="Cyclist")
    lost = good[(good.frame < 2) | ((good.track_id == 3) & (good.frame < 4))]
    results = Objects.concatenate([lost, other[other.frame == 4], alarm, cyclist])
    data = scene_data(clip, {"ours": results})
    (status,) = data["trackers"][0]["errors"]
    status, (missed,) = unpack(status), data["labels"]["errors"]
    missed = unpack(missed)
    entry = Entry("0016", FRAMES, clip.truth, results)
    figures = evaluate_protocol("clear3d", [entry])["overall"]
    found = (missed.sum(), (status == FALSE_ALARM).sum(), (status == SWITCH).sum())
    assert found == (figures["FN"], figures["FP"], figures["IDS"]) == (2, 1, 1)
    assert results.track_id[status == SWITCH].tolist() == [9]
    assert results.track_id[status == NOT_EVALUATED].tolist() == [60]
    lost_rows = clip.truth[missed.astype(bool)]
    assert list(zip(lost_rows.frame, lost_rows.track_id, strict=True)) == [(2, 4), (3, 4)]


def test_a_stricter_iou_makes_more_errors(clip):
    rows = drive([3, 4], 0.4)
    counts = []
    for min_iou in (0.5, 0.9):
        data = scene_data(clip, {"ours": rows}, min_iou=min_iou)
        counts.append(int(unpack(data["labels"]["errors"][0]).sum()))
    assert counts == [0, 2 * FRAMES]


def test_speed_is_over_ground_where_poses_are_known():
    rows = drive([1])
    np.testing.assert_allclose(speeds(rows, None), 8.0)  # 0.8 m in 0.1 s
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 0, 3] = 2.0 * np.arange(FRAMES)  # the sensor drives at 20 m/s
    np.testing.assert_allclose(speeds(rows, poses), 28.0)
    assert np.isnan(speeds(rows[:1], None)).all()


def test_an_id_of_two_classes_in_one_frame_is_two_tracks():
    rows = Objects.concatenate([drive([5]), drive([5], 20, kind="Van")])
    assert len(np.unique(tracks_of(rows))) == 2
    np.testing.assert_allclose(speeds(rows, None), 8.0)
    assert tracks_of(drive([5, 6])).tolist() == [0, 1] * FRAMES


def test_points_may_be_put_in_beforehand(clip):
    """A drive's points, thinned as they come; the note counts those that came."""
    kept = ScenePoints(FRAMES, FOREGROUND, 100)
    for t in range(FRAMES):
        kept.put(t, points(t))
    data = scene_data(clip, {}, points=kept)
    assert data["points"]["shading"] == FOREGROUND
    scan = points(4)[np.sort(np.random.default_rng(4).choice(300, 100, replace=False))]
    assert data["points"]["frames"][4] == pack_points(scan)
    assert data["points"]["frames"][2] == ""
    assert data["notes"][0].startswith("Points of a frame: 100 of up to 300, drawn at random;")
    assert "brighter is more foreground probability" in data["notes"][0]


def test_the_library_is_parsed_once():
    """Its function is in brackets, and nothing traces its errors while it starts."""
    head, tail = deck_gl().splitlines()[:2], deck_gl().splitlines()[-2:]
    assert head == ["const traceLimit = Error.stackTraceLimit;", "Error.stackTraceLimit = 0;"]
    assert tail[0].strip() == "}));" and tail[1] == "Error.stackTraceLimit = traceLimit;"
    assert deck_gl().count("})(globalThis, (function () {") == 1


def test_the_page_stands_alone(clip, tmp_path):
    path = write_scene(tmp_path / "a.html", "A <drive>", scene_data(clip, {"a </b>": drive([1])}))
    text = path.read_text(encoding="utf-8").replace(deck_gl(), "")
    scripts = r"<script[^>]*>.*?</script>|<style>.*?</style>"
    checked = check(re.sub(scripts, "", text, flags=re.DOTALL))
    assert checked.problems == []
    assert "http:" not in text and "https:" not in text and "<title>A &lt;drive&gt;" in text
    assert "default-src 'none'" in text.replace("&#39;", "'")
    assert "sourceMappingURL" not in deck_gl() and "</script" not in deck_gl()
    (data,) = re.findall(r'<script type="application/json" id="scene">(.*?)</script>', text)
    data = json.loads(data)
    assert data["frames"] == FRAMES == len(data["points"]["frames"])
    assert data["trackers"][0]["name"] == "a </b>"


def test_150_frames_take_at_most_25_megabytes():
    scan = np.random.default_rng(0).uniform(0, 1, (20_000, 4)).astype(np.float32)
    clip = Clip("0016", range(150), lambda t: scan, Objects.empty(), drive(range(20), frames=150))
    trackers = {name: drive(range(20), 0.1, 150) for name in ("A", "B")}
    assert len(scene_page("drive", scene_data(clip, trackers)).encode()) < 25e6


def test_a_long_drive_keeps_fewer_points_of_a_frame():
    scan = np.zeros((9000, 4), np.float32)
    clip = Clip("0016", range(1000), lambda t: scan, Objects.empty(), Objects.empty())
    frames = scene_data(clip, {})["points"]["frames"]
    assert len(base64.b64decode(frames[999])) == 7 * 1500
