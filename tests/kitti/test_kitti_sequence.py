"""Sequences: frames from labels or seqmap, gaps in scans, poses, bad folders."""

import numpy as np
import pytest
from helpers.kitti_rows import dont_care_row, label_row

from common.errors import InputError
from kitti.calibration import LEVEL_FROM_CAMERA
from kitti.scans.scan_files import write_scan
from kitti.seqmap import SEQMAP, read_seqmap, write_seqmap
from kitti.sequence import KittiSequence, open_sequences

ROWS = [label_row(0, 1), dont_care_row(3), label_row(5, 1)]


def _add_scans(root, frames, subset="training", seq=0):
    for t in frames:
        path = root / subset / "velodyne" / f"{seq:04d}" / f"{t:06d}.bin"
        write_scan(path, np.array([[20.0, 0, 0, 0.5], [-20, 0, 0, 0.1]], np.float32))


def test_frames_are_known_from_the_last_labelled_one(kitti_folder):
    root = kitti_folder(ROWS)
    _add_scans(root, [0, 1])  # scans are not counted
    sequence = KittiSequence(root, 0)
    assert sequence.name == "0000"
    assert sequence.num_frames == 6
    assert list(sequence.frames) == [0, 1, 2, 3, 4, 5]
    assert len(sequence.objects) == 3


@pytest.mark.parametrize(
    "place", ["training/" + SEQMAP + ".training", SEQMAP + ".training", SEQMAP]
)
def test_seqmap_comes_first(kitti_folder, place):
    root = kitti_folder(ROWS)
    (root / place).write_text("0000 empty 000000 000009\n0007 empty 000000 000001\n")
    assert KittiSequence(root, 0).num_frames == 9


def test_seqmap_of_the_other_subset_or_sequence_is_not_used(kitti_folder):
    root = kitti_folder(ROWS)
    write_seqmap(root, "testing", {0: 20})
    write_seqmap(root, "training", {3: 20})
    assert KittiSequence(root, 0).num_frames == 6


@pytest.mark.parametrize(
    ("row", "frames", "labelled"),
    [("000000 000005", range(5), [0, 3]), ("000003 000005", range(3, 6), [3, 5])],
)
def test_a_seqmap_limits_the_labels(kitti_folder, capsys, row, frames, labelled):
    root = kitti_folder(ROWS)
    (root / SEQMAP).write_text(f"0000 empty {row}\n")
    sequence = KittiSequence(root, 0)
    assert sequence.frames == frames
    assert sequence.objects.frame.tolist() == labelled
    assert "0000.txt: 1 rows outside the seqmap's frames" in capsys.readouterr().err
    (root / "r.txt").write_text("".join(f"{label_row(t, 1)} 0.5\n" for t in range(6)))
    results = sequence.read_results(root / "r.txt")
    assert results.frame.tolist() == list(frames)
    (root / "r.txt").write_text(label_row(6, 1) + "\n")
    with pytest.raises(InputError, match=r"expected 0 to 5, where the seqmap .* ends"):
        sequence.read_results(root / "r.txt")


def test_labels_that_end_before_the_results_are_named(kitti_folder):
    root = kitti_folder(ROWS)
    (root / "r.txt").write_text(label_row(6, 1) + "\n")
    message = r"r\.txt:1: .*expected 0 to 5, where the labels .*0000\.txt end; a seqmap sets the"
    with pytest.raises(InputError, match=message):
        KittiSequence(root, 0).read_results(root / "r.txt")


def test_detections_may_be_a_file_per_frame(kitti_folder):
    root = kitti_folder(ROWS)
    row = "{} -1 -1 -1.5 100 120 200 180 1.5 1.6 4.0 2.0 1.7 20.0 0.3 {}\n"
    for below in ("a/0000", "b/0000/data"):
        folder = root / below
        folder.mkdir(parents=True)
        (folder / "000001.txt").write_text("")
        rows = [row.format(*each) for each in (("car", 2.5), ("DontCare", 1), ("Cyclist", -1))]
        (folder / "000003.txt").write_text("".join(rows))
        (folder / "notes.md").write_text("mine")
        found = KittiSequence(root, 0).read_detections(root / below.split("/")[0])
        assert found.frame.tolist() == [3, 3]
        assert found.type.tolist() == ["Car", "Cyclist"]
        assert found.score.tolist() == [2.5, -1]
        expected = [20, -2, -1.7 + 0.75, 4.0, 1.6, 1.5, -0.3 - np.pi / 2]
        np.testing.assert_allclose(found.boxes[0], expected)
    (folder / "000006.txt").write_text(row.format("Car", 1))
    with pytest.raises(InputError, match=r"000006\.txt: frame beyond .*expected 0 to 5"):
        KittiSequence(root, 0).read_detections(root / "b")
    with pytest.raises(InputError, match=r"expected 0000\.txt .* or 0000/000000\.txt"):
        KittiSequence(root, 0).read_detections(root)


def test_empty_label_file_needs_a_seqmap(kitti_folder):
    root = kitti_folder([])
    with pytest.raises(InputError, match="is empty"):
        assert KittiSequence(root, 0).num_frames
    write_seqmap(root, "training", {0: 5})
    sequence = KittiSequence(root, 0)
    assert sequence.num_frames == 5
    assert len(sequence.objects) == 0
    assert len(sequence.pairs(scans=False)) == 4


def test_a_missing_scan_is_missing_and_breaks_pairs(kitti_folder):
    root = kitti_folder(ROWS)
    _add_scans(root, [0, 1, 4, 5])
    sequence = KittiSequence(root, 0)
    assert [t for t in sequence.frames if sequence.has_scan(t)] == [0, 1, 4, 5]
    assert sequence.pairs() == [(0, 1), (4, 5)]
    assert sequence.pairs(scans=False) == [(t, t + 1) for t in range(5)]
    with pytest.raises(InputError, match=r"000002\.bin: cannot be read"):
        sequence.read_points_level(2)


def test_points_come_in_the_level_frame_and_cropped(kitti_folder, calib):
    root = kitti_folder(ROWS)
    _add_scans(root, [0])
    sequence = KittiSequence(root, 0)
    points = sequence.read_points_level(0, crop=False)
    assert (points.dtype, points.shape) == (np.float32, (2, 4))
    np.testing.assert_allclose(points[0, :3], calib.velo_to_level([[20.0, 0, 0]])[0], rtol=1e-6)
    np.testing.assert_array_equal(points[:, 3], np.float32([0.5, 0.1]))
    np.testing.assert_array_equal(sequence.read_points_level(0), points[:1])
    narrow = KittiSequence(root, 0, image_size=(600, 375))  # the point ahead is at u = 612
    assert len(narrow.read_points_level(0)) == 0


def test_testing_subset_has_no_labels(kitti_folder):
    root = kitti_folder(ROWS)
    (root / "testing").mkdir()
    sequence = KittiSequence(root, 0, "testing")
    assert len(sequence.objects) == 0
    assert sequence.poses is None
    with pytest.raises(InputError, match="neither seqmap nor scans"):
        assert sequence.num_frames
    _add_scans(root, [0, 3], "testing")
    assert KittiSequence(root, 0, "testing").num_frames == 4
    (root / "testing" / (SEQMAP + ".test")).write_text("0000 empty 000000 000006\n")
    assert KittiSequence(root, 0, "testing").num_frames == 6


def test_poses_that_are_not_where_they_belong(kitti_folder, capsys):
    root = kitti_folder(ROWS)
    (root / "poses").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    sequence = KittiSequence(root, 0)
    assert not sequence.has_poses
    with pytest.raises(InputError, match=r"poses: expected a folder with files 00XX\.txt"):
        _ = sequence.poses
    (root / "poses").unlink()
    (root / "poses").mkdir()
    assert KittiSequence(root, 0).poses is None
    assert "poses: there is no 0000.txt, so the ego motion is unknown" in capsys.readouterr().err
    (root / "poses" / "0000.txt").symlink_to(root / "nowhere")
    with pytest.raises(InputError, match=r"0000\.txt: cannot be read"):
        _ = KittiSequence(root, 0).poses


def test_poses_turn_camera_motion_into_level_motion(kitti_folder):
    root = kitti_folder([label_row(t, 1) for t in range(2)])
    assert KittiSequence(root, 0).poses is None
    (root / "poses").mkdir()
    # The camera moves 1 m right, 2 m down, 3 m ahead.
    rows = ["1 0 0 0 0 1 0 0 0 0 1 0", "1 0 0 1 0 1 0 2 0 0 1 3"]
    (root / "poses" / "0000.txt").write_text("\n".join(rows) + "\n")
    poses = KittiSequence(root, 0).poses
    assert poses.shape == (2, 4, 4)
    np.testing.assert_allclose(poses[1], [[1, 0, 0, 3], [0, 1, 0, -1], [0, 0, 1, -2], [0, 0, 0, 1]])
    np.testing.assert_allclose(LEVEL_FROM_CAMERA @ [1.0, 2, 3], [3, -1, -2])
    (root / "poses" / "0000.txt").write_text(rows[0] + "\n" + rows[1].replace("1", "2") + "\n")
    with pytest.raises(InputError, match=r":2: its 3x3 block is not a rotation"):
        assert KittiSequence(root, 0).poses is None
    with np.errstate(all="raise"), pytest.raises(InputError, match="not a rotation"):
        huge = " ".join(["1e308"] * 12)
        (root / "poses" / "0000.txt").write_text(f"{rows[0]}\n{huge}\n")
        assert KittiSequence(root, 0).poses is None
    (root / "poses" / "0000.txt").write_text(rows[0] + "\n")
    with pytest.raises(InputError, match=r"expected 2 rows \(a pose per frame\), found 1"):
        assert KittiSequence(root, 0).poses is None
    (root / SEQMAP).write_text("0000 empty 000001 000001\n")  # row 0 is still frame 0's
    with pytest.raises(InputError, match="expected 2 rows"):
        assert KittiSequence(root, 0).poses is None
    (root / SEQMAP).unlink()
    (root / "poses" / "0000.txt").write_text("1 2 3\n")
    with pytest.raises(InputError, match=r":1: expected 12 columns, found 3"):
        assert KittiSequence(root, 0).poses is None


def test_missing_files(kitti_folder, tmp_path):
    with pytest.raises(InputError, match="expected a folder training/"):
        KittiSequence(tmp_path / "nowhere", 0)
    root = kitti_folder(ROWS)
    with pytest.raises(InputError, match=r"0004\.txt: sequence 0004 has no label file"):
        open_sequences(root, [0, 4])
    with pytest.raises(InputError, match="subset: expected training or testing"):
        KittiSequence(root, 0, "validation")
    (root / "training" / "label_02" / "0005.txt").mkdir()
    with pytest.raises(InputError, match="found a directory"):
        assert KittiSequence(root, 5).objects


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0000 empty 000000\n", ":1: expected 4 columns, found 3"),
        ("0000 empty -00001 000005\n", ":1: column 3: expected a first frame >= 0"),
        ("0000 empty 000007 000005\n", ":1: column 4: expected a last frame from column 3 on"),
        ("0000 empty 000000 2000000000\n", ":1: column 4: expected at most 100000 frames"),
        ("0000 empty 000000 000000\n", ":1: column 4: expected a number of frames above 0"),
        ("0000 empty 000000 5\n0000 empty 000000 5\n", ":2: sequence 0000 is there twice"),
        ("0000 empty 000000 x\n", ":1: column 4: expected a number, found 'x'"),
    ],
)
def test_bad_seqmaps(tmp_path, text, message):
    (tmp_path / "map").write_text(text)
    with pytest.raises(InputError, match=message):
        read_seqmap(tmp_path / "map")


def test_seqmap_round_trip(tmp_path):
    frames = {20: 837, 0: 154}
    found = read_seqmap(write_seqmap(tmp_path, "training", frames))
    assert found == {20: range(837), 0: range(154)}


@pytest.mark.real
def test_real_sequences(kitti_root):
    sequences = open_sequences(kitti_root, range(21))
    assert sum(sequence.num_frames for sequence in sequences) == 8008
    assert sequences[0].pairs() == [(t, t + 1) for t in range(153)]
    sizes = [sequence.image_size for sequence in sequences]
    assert sizes[:1] + sizes[17:] == [
        (1242, 375),
        (1224, 370),
        (1238, 374),
        (1238, 374),
        (1241, 376),
    ]
    for sequence, (width, height) in zip(sequences, sizes, strict=True):
        # One interpolated label of 0019 reaches 0.8 pixels beyond the image.
        assert (sequence.objects.bbox.max(axis=0)[2:] < (width + 1, height + 1)).all()
        np.testing.assert_allclose(sequence.poses[0], np.eye(4), atol=1e-9)
