"""Labels, results and detections: round trips, and every kind of bad row."""

import contextlib

import numpy as np
import pytest
from helpers.kitti_rows import DETECTION, dont_care_row, label_row, write_rows
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.errors import InputError
from kitti.boxes import wrap_angle
from kitti.detections import read_detection_folder, read_detections
from kitti.labels import (
    read_labels,
    read_results,
    write_labels,
    write_results,
)
from kitti.objects import VEHICLES, Objects


def test_reads_all_columns(tmp_path):
    rows = [dont_care_row(0), label_row(0, 3), label_row(2, 3, "Van", z=30.0)]
    objects = read_labels(write_rows(tmp_path / "l.txt", rows))
    assert objects.frame.tolist() == [0, 0, 2]
    assert objects.track_id.tolist() == [-1, 3, 3]
    assert objects.type.tolist() == ["DontCare", "Car", "Van"]
    assert objects.occlusion.tolist() == [-1, 1, 1]
    assert np.isnan(objects.boxes[0]).all()
    assert np.isnan(objects.score).all()
    np.testing.assert_allclose(objects.bbox[1], [100, 120, 200, 180])
    expected = [30, -2, -1.7 + 0.75, 4.0, 1.6, 1.5, -0.3 - np.pi / 2]
    np.testing.assert_allclose(objects.boxes[2], expected)
    assert objects.boxes.dtype == np.float64
    assert (objects.frame.dtype, objects.track_id.dtype) == (np.int32, np.int64)


def test_rows_are_sorted_by_frame_stably(tmp_path):
    rows = [label_row(5, 1), label_row(0, 2), label_row(5, 0), label_row(0, 1)]
    objects = read_labels(write_rows(tmp_path / "l.txt", rows))
    assert objects.frame.tolist() == [0, 0, 5, 5]
    assert objects.track_id.tolist() == [2, 1, 1, 0]


def test_blank_lines_and_other_line_ends_are_no_matter(tmp_path):
    path = tmp_path / "l.txt"
    path.write_bytes((label_row(0, 1) + "\r\n\r\n  " + label_row(1, 1)).encode())
    assert read_labels(path).frame.tolist() == [0, 1]


def test_chosen_rows(tmp_path):
    rows = [dont_care_row(0), label_row(0, 3), label_row(2, 3, "Van"), label_row(2, 4, "Tram")]
    objects = read_labels(write_rows(tmp_path / "l.txt", rows))
    assert objects.of_classes(VEHICLES).type.tolist() == ["Car", "Van"]
    assert objects.at(2).track_id.tolist() == [3, 4]
    assert len(objects.at(1)) == len(objects.at(99)) == 0
    assert objects[objects.frame == 2].at(2).type.tolist() == ["Van", "Tram"]
    backwards = objects[np.array([3, 2, 1, 0])]
    assert backwards.at(0).type.tolist() == ["Car", "DontCare"]
    both = Objects.concatenate([objects, objects.at(0)])
    assert both.frame.tolist() == [0, 0, 2, 2, 0, 0]
    assert both.type.dtype == objects.type.dtype
    assert len(Objects.concatenate([])) == len(Objects.empty()) == 0


def test_objects_refuse_arrays_that_do_not_run_in_parallel():
    fields = {name: getattr(Objects.empty(), name) for name in Objects.__dataclass_fields__}
    with pytest.raises(ValueError, match=r"bbox: expected shape \(0, 4\)"):
        Objects(**{**fields, "bbox": np.zeros((1, 4))})


coordinate = st.floats(-500, 500)
length = st.floats(0.01, 50)
ry = st.floats(-3.14159, 3.14159)
kinds = st.sampled_from(["Car", "Van", "Pedestrian", "Person", "Person_sitting", "DontCare"])
row = st.tuples(
    st.integers(0, 60), kinds, st.tuples(*[coordinate] * 2), st.tuples(*[length] * 5),
    st.tuples(*[coordinate] * 3), ry, st.floats(-50, 50),
)  # fmt: skip


def _objects(rows):
    parts = []
    for track_id, (frame, kind, corner, sizes, place, turn, score) in enumerate(rows):
        cared = kind != "DontCare"
        box = (
            np.array([[*place, *sizes[:3], wrap_angle(turn)]]) if cared else np.full((1, 7), np.nan)
        )
        bbox = np.array([[*corner, corner[0] + sizes[3], corner[1] + sizes[4]]])
        identity = track_id if cared else -1
        parts.append(Objects.from_boxes(frame, identity, box, score, kind=kind, bbox=bbox))
    both = Objects.concatenate(parts)
    return both[np.argsort(both.frame, kind="stable")]


def _assert_same(a, b, scores):
    for name in ("frame", "track_id", "occlusion", "truncation"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert a.type.tolist() == b.type.tolist()
    np.testing.assert_allclose(a.bbox, b.bbox, atol=1e-6)
    np.testing.assert_allclose(a.alpha, b.alpha, atol=1e-6)
    np.testing.assert_allclose(a.boxes[:, :6], b.boxes[:, :6], atol=2e-6)
    turn = wrap_angle(a.boxes[:, 6] - b.boxes[:, 6])
    assert np.nanmax(np.abs(turn), initial=0) < 1e-6
    if scores:
        np.testing.assert_allclose(a.score, b.score, atol=1e-6)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(rows=st.lists(row, min_size=1, max_size=12))
def test_round_trips(tmp_path, rows):
    objects = _objects(rows)
    path = tmp_path / "r.txt"
    write_results(path, objects)
    _assert_same(read_results(path), objects, scores=True)
    write_labels(path, objects)
    _assert_same(read_labels(path), objects, scores=False)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(data=st.data())
def test_any_damage_is_read_or_refused_with_the_file_named(tmp_path, data):
    text = "".join(label_row(t, t % 3) + "\n" for t in range(4)).encode()
    at = data.draw(st.integers(0, len(text) - 1))
    damage = data.draw(st.binary(max_size=6))
    path = tmp_path / "l.txt"
    path.write_bytes(text[:at] + damage + text[at + len(damage) :])
    try:
        objects = read_labels(path)
    except InputError as error:
        assert str(error).startswith(str(path))
        assert "\n" not in str(error)
    else:
        cared = objects[objects.type != "DontCare"]
        assert np.isfinite(cared.boxes).all()
        assert (cared.boxes[:, 3:6] > 0).all()


def test_cut_files_are_refused(tmp_path):
    text = "".join(label_row(t, 0) + "000\n" for t in range(3))  # ends in 0.3000
    path = tmp_path / "l.txt"
    last = text[:-1].rindex("\n") + 1
    for end in range(last + 1, len(text) - 1):
        path.write_text(text[:end])
        with pytest.raises(InputError, match=r"l\.txt:3: (expected 17 columns|the file is cut)"):
            read_labels(path)
    path.write_text(text[:-1])  # only the line's end is missing
    assert len(read_labels(path)) == 3


@pytest.mark.parametrize("digits", [2, 4])
@pytest.mark.parametrize("rows", [2, 12])
def test_rounded_scores_without_a_last_line_end_are_read(tmp_path, digits, rows):
    """`round` leaves zeros at the end out, so that the last score may be the shortest."""
    scores = [round(0.1 + (i % 9 + 1) * 10**-digits, digits) for i in range(rows - 1)] + [0.5]
    places = [label_row(t, 0) for t in range(rows)]
    lines = [f"{place} {score}" for place, score in zip(places, scores, strict=True)]
    (tmp_path / "r.txt").write_text("\n".join(lines))
    assert read_results(tmp_path / "r.txt").score.tolist() == scores
    fixed = [f"{p} {s:.{digits + 1}f}" for p, s in zip(places, scores, strict=True)]
    (tmp_path / "r.txt").write_text("\n".join(fixed)[:-1])
    with pytest.raises(InputError, match=r"the file is cut off: its last number is '0\.50"):
        read_results(tmp_path / "r.txt")


def _changed(column, value):
    words = label_row(7, 1).split()
    words[column - 1] = value
    return " ".join(words)


BAD_ROWS = [
    ("1 2 3", "expected 17 columns, found 3"),
    (label_row(7, 1) + " 0.5", "expected 17 columns, found 18"),
    (_changed(1, "-1"), "column 1: expected a frame number >= 0"),
    (_changed(1, "1.5"), "column 1: expected an integer frame number"),
    (_changed(1, "99999999999"), "column 1: expected an integer frame number"),
    (_changed(1, "999999"), "column 1: frame beyond the sequence, expected 0 to 99999"),
    (_changed(1, "x"), "column 1: expected a number, found 'x'"),
    (_changed(2, "-1"), "column 2: expected a track id >= 0"),
    (_changed(2, "a"), "column 2: expected a number"),
    (_changed(2, "1_0"), "column 2: expected a finite number, found '1_0'"),
    (_changed(3, "Bus"), "column 3: unknown class 'Bus', expected one of Car Van"),
    (_changed(2, str(2**63)), r"column 2: expected an integer track id below 2\^63, found 92233"),
    (_changed(5, "0.5"), "column 5: expected an integer occlusion"),
    (_changed(7, "300"), "columns 7-10: expected x1 <= x2"),
    (_changed(10, "100"), "columns 7-10: expected x1 <= x2, y1 <= y2"),
    (_changed(11, "0"), "columns 11-13: expected sizes h w l above 0"),
    (_changed(13, "-4"), "columns 11-13: expected sizes h w l above 0"),
    (_changed(12, "1e-300"), "columns 11-13: expected sizes h w l of at least 0.001 metres"),
    (_changed(13, "1000.1"), "columns 11-13: expected sizes h w l of at most 1000 metres"),
    (_changed(4, "1e308"), "expected numbers of magnitude 1e.07 at most"),
    (_changed(14, "1e308"), "expected numbers of magnitude 1e.07 at most"),
    (_changed(14, "nan"), "column 14: expected a finite number, found 'nan'"),
    (_changed(16, "inf"), "column 16: expected a finite number, found 'inf'"),
    (_changed(17, "-inf"), "column 17: expected a finite number"),
    (_changed(17, "-119.5"), "column 17: expected a heading in radians"),
    (
        " ".join([*label_row(7, 1).split()[:10], "-1 -1 -1 -1000 -1000 -1000 -10"]),
        "columns 11-13: expected sizes h w l above 0",
    ),
    (_changed(17, "0.3.1"), "column 17: expected a number, found '0.3.1'"),
    (label_row(0, 1), "frame 0 has track id 1 twice"),
]


@pytest.mark.parametrize(("bad", "message"), BAD_ROWS)
def test_bad_row_is_named(tmp_path, bad, message):
    path = write_rows(tmp_path / "l.txt", [label_row(0, 1), dont_care_row(0), bad, label_row(9, 1)])
    with pytest.raises(InputError, match=message) as error:
        read_labels(path)
    assert str(error.value).startswith(f"{path}:3: ")


@pytest.mark.parametrize("identity", [2**32, 2**53 + 1, 2**63 - 1])
def test_large_ids_are_read_exactly(tmp_path, identity):
    objects = read_labels(
        write_rows(tmp_path / "l.txt", [_changed(2, str(identity)), label_row(8, 1)])
    )
    assert objects.track_id.tolist() == [identity, 1]


def test_classes_are_read_in_any_case(tmp_path):
    rows = [_changed(3, name) for name in ("car", "PERSON_SITTING", "dontcare")]
    rows[1] = rows[1].replace("7 1", "8 1", 1)
    found = read_labels(write_rows(tmp_path / "l.txt", rows))
    assert found.type.tolist() == ["Car", "DontCare", "Person_sitting"]


def test_ids_of_dont_care_regions_are_no_matter(tmp_path):
    numbered = dont_care_row(0).replace("0 -1", "0 3", 1)
    rows = [numbered, numbered, label_row(0, 3), label_row(1, 3)]
    assert read_labels(write_rows(tmp_path / "l.txt", rows)).track_id.tolist() == [-1, -1, 3, 3]


def test_headings_in_degrees_are_refused_in_every_layout(tmp_path):
    """-6.5 radians, which trackers that do not wrap write, is read."""
    car = DETECTION.format(frame=0, score=1)
    files = {
        "0000": car.replace(",0.3,", ",{},"),
        "0001": label_row(0, 1).removesuffix("0.3") + "{} 0.9",
        "0002/000000": " ".join([*label_row(0, 1).split()[2:-1], "{} 0.9"]),
    }
    (tmp_path / "0002").mkdir()
    for name, row in files.items():
        for heading in (-6.5, 90.0):
            write_rows(tmp_path / f"{name}.txt", [row.format(heading)])
            refused = pytest.raises(InputError, match="expected a heading in radians")
            with contextlib.nullcontext() if heading < 0 else refused:
                assert len(read_detection_folder(tmp_path, name[:4], 1)) == 1


def test_sizes_in_another_order_are_noted(tmp_path, capsys):
    """l w h instead of h w l."""
    good = [label_row(0, 1), label_row(0, 2, "Pedestrian").replace("1.6 4.0", "1.6 0.6")]
    read_labels(write_rows(tmp_path / "a.txt", good))
    assert capsys.readouterr().err == ""
    read_labels(
        write_rows(tmp_path / "b.txt", [good[0].replace("1.5 1.6 4.0", "4.0 1.6 1.5"), good[1]])
    )
    expected = "b.txt: vehicles are higher than long; columns 11-13: expected sizes h w l"
    assert expected in capsys.readouterr().err


def test_an_id_may_be_there_once_per_class(tmp_path, capsys):
    rows = [label_row(0, 7), _changed(3, "Van").replace("7 1", "0 7", 1), label_row(1, 7)]
    found = read_results(write_rows(tmp_path / "r.txt", rows))
    car, van, car_later = found.track_id.tolist()
    assert car == car_later != van
    assert capsys.readouterr().err == (
        f"note: {tmp_path / 'r.txt'}: a track id belongs to two classes in a frame; "
        "all ids are renumbered\n"
    )


def test_an_id_of_two_classes_in_turn_is_one_track_whatever_other_ids_do(tmp_path):
    rows = [label_row(0, 7), label_row(0, 7, "Van"), label_row(0, 5), label_row(1, 5, "Van")]
    ids = read_results(write_rows(tmp_path / "r.txt", rows)).track_id.tolist()
    assert ids[2] == ids[3] and len(set(ids)) == 3


def test_line_ends_of_other_systems(tmp_path):
    text = "".join(label_row(t, 0) + "000\n" for t in range(3))
    (tmp_path / "unix.txt").write_bytes(text.encode())
    expected = read_labels(tmp_path / "unix.txt")
    for end in ("\r\n", "\r"):
        windows = b"\xef\xbb\xbf" + text.rstrip("\n").replace("\n", end).encode()
        (tmp_path / "windows.txt").write_bytes(windows)
        _assert_same(read_labels(tmp_path / "windows.txt"), expected, scores=False)


def test_result_rows_are_checked_alike(tmp_path):
    rows = [label_row(0, 1) + " 0.9", label_row(0, 1) + " 0.8"]
    with pytest.raises(InputError, match=r":2: frame 0 has track id 1 twice"):
        read_results(write_rows(tmp_path / "r.txt", rows))
    with pytest.raises(InputError, match=r":2: expected 18 columns, found 17"):
        read_results(write_rows(tmp_path / "r.txt", [rows[0], label_row(1, 1)]))
    with pytest.raises(InputError, match=r":1: expected 17 or 18 columns, found 2"):
        read_results(write_rows(tmp_path / "r.txt", ["0 1"]))
    with pytest.raises(InputError, match=r":1: column 18: expected a finite number"):
        read_results(write_rows(tmp_path / "r.txt", [label_row(0, 1) + " nan"]))


def test_frame_beyond_the_sequence(tmp_path):
    path = write_rows(tmp_path / "l.txt", [label_row(3, 0), label_row(4, 0)])
    assert len(read_labels(path, 5)) == 2
    with pytest.raises(InputError, match=r":2: .*frame beyond the sequence, expected 0 to 3"):
        read_labels(path, 4)


def test_empty_files(tmp_path):
    path = tmp_path / "e.txt"
    for content in (b"", b"\n \n"):
        path.write_bytes(content)
        with pytest.raises(InputError, match="is empty, expected label rows"):
            read_labels(path)
        assert len(read_labels(path, num_frames=3)) == 0
        assert len(read_results(path)) == 0
        assert len(read_detections(path)) == 0


@pytest.mark.parametrize("read", [read_labels, read_results, read_detections])
def test_not_a_text_file(tmp_path, read):
    path = tmp_path / "l.txt"
    path.write_bytes(label_row(0, 0).encode() + b"\n0 1 C\xffr\n")
    with pytest.raises(InputError, match=r"l\.txt:2: expected plain text, found byte 0xff"):
        read(path)
    with pytest.raises(InputError, match="expected a file, found a directory"):
        read(tmp_path)
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read(tmp_path / "absent.txt")


def test_results_without_scores_or_3d_boxes(tmp_path):
    flat = "0 1 Car -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10"
    objects = read_results(write_rows(tmp_path / "r.txt", [flat]))
    assert np.isnan(objects.boxes).all()
    assert np.isnan(objects.score).all()
    for sizes in ("-1 -1 -2", "-2 -2 -2", "0 1.6 4"):
        with pytest.raises(InputError, match="sizes h w l above 0"):
            read_results(write_rows(tmp_path / "r.txt", [flat.replace("-1 -1 -1 -", f"{sizes} -")]))


def test_writers_refuse_unreadable_values(tmp_path):
    box = np.array([[20.0, 0, 0, 4, 2, 1.5, 0]])
    with pytest.raises(ValueError, match="finite score"):
        write_results(tmp_path / "r.txt", Objects.from_boxes(0, 1, box))
    with pytest.raises(ValueError, match="row 0: expected finite numbers"):
        write_results(
            tmp_path / "r.txt", Objects.from_boxes(0, 1, box * [np.inf, 1, 1, 1, 1, 1, 1], 0.5)
        )
    assert not (tmp_path / "r.txt").exists()


def test_results_of_boxes_outside_the_image(tmp_path):
    box = np.array([[20.0, 0, 0, 4, 2, 1.5, 0]])
    write_results(tmp_path / "r.txt", Objects.from_boxes(4, 1, box, 0.5))
    words = (tmp_path / "r.txt").read_text().split()
    assert words[:10] == ["4", "1", "Car", "-1", "-1", words[5], *["-1.000000"] * 4]
    assert words[17] == "0.500000"


@pytest.mark.real
def test_all_real_labels_come_back_to_1e_4(kitti_root, tmp_path):
    vehicles = 0
    for path in sorted((kitti_root / "training" / "label_02").glob("*.txt")):
        objects = read_labels(path)
        vehicles += len(objects.of_classes(VEHICLES))
        write_labels(tmp_path / "l.txt", objects)
        before = [line.split() for line in path.read_text().splitlines()]
        after = [line.split() for line in (tmp_path / "l.txt").read_text().splitlines()]
        assert [row[2] for row in before] == [row[2] for row in after]
        a, b = (np.array([r[:2] + r[3:] for r in rows], float) for rows in (before, after))
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-4)
    assert vehicles == 30601
