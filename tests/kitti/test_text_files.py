"""Text files of other systems and other layouts: encodings, gzip, detections of one sequence."""

import gzip
import os

import numpy as np
import pytest
from helpers.kitti_rows import dont_care_row, label_row

from common.errors import InputError
from kitti.labels import read_labels
from kitti.sequence import KittiSequence, labelled_sequences

TEXT = "".join(label_row(t, i) + "\n" for t in range(4) for i in (0, 1))
RESULT = "{} {} Car -1 -1 -1.5 100 120 200 180 1.5 1.6 4.0 2.0 1.7 20.0 0.3 {}\n"
OBJECT = "Car -1 -1 -1.5 100 120 200 180 1.5 1.6 4.0 2.0 1.7 20.0 0.3 0.9\n"


@pytest.mark.parametrize(
    "data",
    [
        gzip.compress(TEXT.encode(), mtime=0),
        TEXT.encode("utf-16"),
        b"\xfe\xff" + TEXT.encode("utf-16-be"),
        TEXT.encode("utf-8-sig"),
        gzip.compress(TEXT.replace("\n", "\r\n").encode("utf-16"), mtime=0),
    ],
)
def test_text_is_read_from_gzip_and_utf_16(tmp_path, data):
    path = tmp_path / "0000.txt"
    path.write_bytes(data)
    assert read_labels(path).frame.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (gzip.compress(TEXT.encode(), mtime=0)[:-9], "expected plain text: "),
        (b"\x1f\x8b\x08 no gzip", "expected plain text: "),
        (gzip.compress(bytes(2**28 + 1), mtime=0), "expected at most 268435456 bytes of text"),
        (TEXT.encode("utf-16")[:-1], "expected plain text: .*utf-16"),
        (TEXT.encode("utf-16-le"), ":1: expected plain text, found byte 0x00"),
        (TEXT.encode() + b"\0", ":9: expected plain text, found byte 0x00"),
    ],
)
def test_damaged_or_undeclared_text_is_refused(tmp_path, data, message):
    path = tmp_path / "0000.txt"
    path.write_bytes(data)
    with pytest.raises(InputError, match=message):
        read_labels(path)


def test_packed_labels_and_detections_are_found_by_name(kitti_folder):
    root = kitti_folder([label_row(0, 0), label_row(3, 0)])
    label = root / "training" / "label_02" / "0000.txt"
    label.with_name("0000.txt.gz").write_bytes(gzip.compress(label.read_bytes()))
    label.unlink()
    assert KittiSequence(root, 0).num_frames == 4
    (root / "d").mkdir()
    (root / "d" / "0000.txt.gz").write_bytes(gzip.compress(RESULT.format(2, 7, 0.5).encode()))
    assert KittiSequence(root, 0).read_detections(root / "d").frame.tolist() == [2]


def test_packed_calibration_and_poses_are_found_by_name(kitti_folder):
    root = kitti_folder([label_row(0, 0)])
    (root / "poses").mkdir()
    (root / "poses" / "0000.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 2.5\n")
    plain = KittiSequence(root, 0)
    calib, poses = plain.calib, plain.poses
    for path in (plain.calib_path, plain.poses_path, plain.label_path):
        path.with_name("0000.txt.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    packed = KittiSequence(root, 0)
    np.testing.assert_array_equal(packed.calib.p2, calib.p2)
    np.testing.assert_array_equal(packed.poses, poses)
    assert packed.has_poses and labelled_sequences(root) == [0]


def test_detections_may_be_kitti_results(kitti_folder, capsys):
    root = kitti_folder([label_row(0, 0), label_row(3, 0)])
    flat = "2 -1 Car -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10 0.7\n"
    rows = [RESULT.format(2, -1, 0.5), RESULT.format(2, -1, 0.4), RESULT.format(1, 3, 0.3), flat]
    rows += [f"{dont_care_row(2)} 0.9\n", RESULT.format(2, -1, 0.8).replace("Car", "DontCare")]
    (root / "0000.txt").write_text("".join(rows))
    found = KittiSequence(root, 0).read_detections(root)
    assert "0000.txt: 1 of 6 rows have no 3-D box and are left out" in capsys.readouterr().err
    assert found.frame.tolist() == [1, 2, 2]
    assert found.score.tolist() == [0.3, 0.5, 0.4]
    assert found.track_id.tolist() == [-1, -1, -1]
    np.testing.assert_allclose(found.boxes[0, 3:6], [4.0, 1.6, 1.5])
    (root / "0000.txt").write_text(RESULT.format(4, -1, 0.5))
    with pytest.raises(InputError, match=r"0000\.txt:1: .*frame beyond the sequence"):
        KittiSequence(root, 0).read_detections(root)


AB3DMOT = "2,2,100,120,200,180,0.5,1.5,1.6,4.0,2.0,1.7,20.0,0.3,-1.5\n"


@pytest.mark.parametrize("separator", [",", " ", "  ", "\t", ", "])
def test_columns_may_be_between_commas_or_white_space(kitti_folder, separator):
    root = kitti_folder([label_row(0, 0), label_row(3, 0)])
    expected = [20, -2, -1.7 + 0.75, 4.0, 1.6, 1.5, -0.3 - np.pi / 2]
    for text in (AB3DMOT, RESULT.format(2, 7, 0.5).replace(" ", ",")):
        (root / "0000.txt").write_text(text.replace(",", separator))
        found = KittiSequence(root, 0).read_detections(root)
        assert (found.frame.tolist(), found.type.tolist(), found.score.tolist()) == (
            [2], ["Car"], [0.5]
        )  # fmt: skip
        np.testing.assert_allclose(found.boxes[0], expected)
        np.testing.assert_allclose(found.bbox[0], [100, 120, 200, 180])
    labels = root / "training" / "label_02" / "0000.txt"
    labels.write_text(labels.read_text().replace(" ", separator))
    assert KittiSequence(root, 0).objects.type.tolist() == ["Car", "Car"]


def test_types_may_be_names(kitti_folder):
    root = kitti_folder([label_row(0, 0), label_row(3, 0)])
    (root / "0000.txt").write_text(
        AB3DMOT.replace("2,2,", "2,car,") + AB3DMOT.replace("2,2,", "3,Van,")
    )
    found = KittiSequence(root, 0).read_detections(root)
    assert (found.frame.tolist(), found.type.tolist()) == ([2, 3], ["Car", "Van"])
    (root / "0000.txt").write_text(AB3DMOT.replace("2,2,", "2,bus,"))
    with pytest.raises(InputError, match=r":1: column 2: unknown class 'bus', expected one of Car"):
        KittiSequence(root, 0).read_detections(root)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (AB3DMOT.replace(",-1.5", ""), r":1: expected 15 columns .* 17 or 18 .*, found 14: 2 "),
        ("\n" + AB3DMOT[2:], r":2: expected 15 .*, found 14: 2 "),
        (OBJECT, r"found 16: Car \.\.\.; a file without frame .*: 0000/000000\.txt"),
        (OBJECT.replace(" 0.9", ""), r"found 15: Car \.\.\.; a file without frame"),
        ("frame,type,x1,y1,x2,y2,score,h,w,l,x,y,z,ry,alpha\n", "found 15: frame "),
        (AB3DMOT + AB3DMOT.replace(",", " "), r":2: expected 15 columns, found 1 "),
    ],
)
def test_other_columns_are_refused_with_those_that_are_expected(kitti_folder, text, message):
    root = kitti_folder([label_row(0, 0), label_row(3, 0)])
    (root / "0000.txt").write_text(text)
    with pytest.raises(InputError, match=message):
        KittiSequence(root, 0).read_detections(root)


def test_an_id_behind_the_score_of_a_file_per_frame_is_not_used(kitti_folder):
    root = kitti_folder([label_row(0, 0), label_row(3, 0)])
    (root / "d" / "0000").mkdir(parents=True)
    (root / "d" / "0000" / "000002.txt").write_text(OBJECT.replace("0.9", "0.9 12"))
    found = KittiSequence(root, 0).read_detections(root / "d")
    assert (found.score.tolist(), found.track_id.tolist()) == ([0.9], [-1])


@pytest.mark.parametrize("below", ["flat", "flat/data"])
def test_files_per_frame_of_a_single_sequence(kitti_folder, below):
    root = kitti_folder([label_row(0, 0), label_row(3, 0)])
    (root / below).mkdir(parents=True)
    for name in ("0002", "0003"):  # other sequences
        (root / below / f"{name}.txt").write_text(AB3DMOT)
    with pytest.raises(InputError, match=r"flat: expected 0000\.txt"):
        KittiSequence(root, 0).read_detections(root / "flat", alone=True)
    (root / below / "000002.txt").write_text(OBJECT)
    found = KittiSequence(root, 0).read_detections(root / "flat", alone=True)
    assert found.frame.tolist() == [2]
    with pytest.raises(InputError, match=r"expected 0000\.txt"):
        KittiSequence(root, 0).read_detections(root / "flat")


@pytest.mark.parametrize("name", ["0000.txt", "evaluate_tracking.seqmap"])
def test_names_that_cannot_be_read_are_not_passed_over(kitti_folder, name):
    root = kitti_folder([label_row(0, 0)])
    for make, message in (
        (lambda path: path.symlink_to(path.name), "Too many levels of symbolic links"),
        (os.mkfifo, "found a pipe"),
        (os.mkdir, "found a directory"),
    ):
        path = root / name
        make(path)
        with pytest.raises(InputError, match=message):
            KittiSequence(root, 0).read_detections(root)
        path.rmdir() if path.is_dir() else path.unlink()


def test_scans_after_the_last_label_are_noted(kitti_folder, capsys):
    root = kitti_folder([label_row(0, 0), label_row(3, 0)])
    scans = root / "training" / "velodyne" / "0000"
    scans.mkdir(parents=True)
    with pytest.raises(InputError, match=r"0000: expected scans such as 000000\.bin to 000003\.b"):
        KittiSequence(root, 0).check_scans()
    (scans / "000003.bin").touch()
    KittiSequence(root, 0).check_scans()
    error = capsys.readouterr().err
    assert "the labels end" not in error and f"{scans}: 3 of 4 frames have no scan\n" in error
    (scans / "000004.bin").touch()
    assert KittiSequence(root, 0).num_frames == 4
    assert "the labels end at frame 3, the scans do not" in capsys.readouterr().err


def test_positions_beyond_reason_are_refused(kitti_folder):
    root = kitti_folder([label_row(0, 0)])
    (root / "poses").mkdir()
    (root / "poses" / "0000.txt").write_text("1 0 0 1e300 0 1 0 0 0 0 1 0\n")
    with pytest.raises(InputError, match=r"0000\.txt:1: expected a position within 1e\+07 metres"):
        assert KittiSequence(root, 0).poses is not None
