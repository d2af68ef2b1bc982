"""`kitti2d` and `hota` against the trackeval package reading the same files."""

import contextlib
import io
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.metric_cases import random_entry, rows

from common.errors import InputError
from kitti.labels import read_labels, read_results, write_labels, write_results
from kitti.objects import Objects
from metrics.kitti_rules import boxes_in_dontcare
from metrics.protocols import Entry, evaluate_protocol

FIELDS = {"TP": "CLR_TP", "FP": "CLR_FP", "FN": "CLR_FN", "IDS": "IDSW", "FRAG": "Frag"}
RATIOS = {"MOTA": "MOTA", "MOTP": "MOTP", "MT": "MTR", "ML": "MLR"}


def write(folder: Path, entries: list[Entry]) -> list[Entry]:
    """Writes files for trackeval; returns the entries that the project reads from them."""
    (folder / "gt" / "label_02").mkdir(parents=True)
    (folder / "trackers" / "ours" / "data").mkdir(parents=True)
    seqmap = "".join(f"{e.name} empty 000000 {e.num_frames:06d}\n" for e in entries)
    (folder / "gt" / "evaluate_tracking.seqmap.training").write_text(seqmap)
    read = []
    for e in entries:
        labels = folder / "gt" / "label_02" / f"{e.name}.txt"
        results = folder / "trackers" / "ours" / "data" / f"{e.name}.txt"
        write_labels(labels, e.truth)
        write_results(results, e.results)
        read.append(
            Entry(
                e.name,
                e.num_frames,
                read_labels(labels, e.num_frames),
                read_results(results, e.num_frames),
            )
        )
    return read


def trackeval_says(folder: Path, kind: str = "car") -> dict:
    """{sequence or "all": {metric: fields}} of trackeval's Kitti2DBox for one class."""
    import trackeval

    with contextlib.redirect_stdout(io.StringIO()):
        data = trackeval.datasets.Kitti2DBox(
            {
                "GT_FOLDER": str(folder / "gt"),
                "TRACKERS_FOLDER": str(folder / "trackers"),
                "TRACKERS_TO_EVAL": ["ours"],
                "CLASSES_TO_EVAL": [kind],
                "PRINT_CONFIG": False,
            }
        )
        measures = [
            trackeval.metrics.CLEAR({"PRINT_CONFIG": False}),
            trackeval.metrics.HOTA(),
            trackeval.metrics.Identity({"PRINT_CONFIG": False}),
        ]
        out: dict = {}
        for measure in measures:
            parts = {}
            for name in data.seq_list:
                raw = data.get_raw_seq_data("ours", name)
                parts[name] = measure.eval_sequence(data.get_preprocessed_seq_data(raw, kind))
            for name, fields in {**parts, "all": measure.combine_sequences(parts)}.items():
                out.setdefault(name, {})[measure.get_name()] = fields
    return out


def check(folder: Path, entries: list[Entry], kind: str = "Car") -> dict:
    """Asserts equality in every sequence and in all; returns the project's overall figures."""
    entries = write(folder, entries)
    expected = trackeval_says(folder, kind.lower())
    clear, hota = (
        evaluate_protocol(name, entries, classes=(kind,)) for name in ("kitti2d", "hota")
    )
    for name, figures in {**clear["sequences"], "all": clear["overall"]}.items():
        says = expected[name]["CLEAR"]
        for ours, theirs in FIELDS.items():
            assert figures[ours] == says[theirs], (name, ours)
        if figures["GT"]:
            for ours, theirs in RATIOS.items():
                value = 0.0 if figures[ours] is None else figures[ours]
                assert value == pytest.approx(says[theirs], abs=1e-9), (name, ours)
    for name, figures in {**hota["sequences"], "all": hota["overall"]}.items():
        if figures["HOTA"] is None:
            continue
        for key in ("HOTA", "DetA", "AssA"):
            says = np.mean(expected[name]["HOTA"][key])
            assert figures[key] == pytest.approx(says, abs=1e-9), (name, key)
        assert figures["IDF1"] == pytest.approx(expected[name]["Identity"]["IDF1"], abs=1e-9)
        matched = expected[name]["HOTA"]["HOTA_TP"] > 0
        located = expected[name]["HOTA"]["LocA"][matched]
        assert figures["LocA"] == (
            pytest.approx(located.mean(), abs=1e-9) if len(located) else None
        )
    return clear["overall"]


def test_equals_trackeval_on_careless_trackers(tmp_path):
    entries = [random_entry(seed, objects=6, name=f"{seed:04d}") for seed in range(8)]
    overall = check(tmp_path, entries)
    for key in ("TP", "FP", "FN", "IDS", "FRAG"):
        assert overall[key] > 5, key  # every kind of event is there


def as_people(objects: Objects) -> Objects:
    """The same rows with cars as pedestrians, vans as sitting persons, and the other way round."""
    names = {"Car": "Pedestrian", "Van": "Person", "Pedestrian": "Car", "DontCare": "DontCare"}
    return replace(objects, type=np.array([names[name] for name in objects.type.tolist()], "<U16"))


def test_pedestrians_equal_trackeval(tmp_path):
    cars = [random_entry(seed, objects=6, name=f"{seed:04d}") for seed in range(4)]
    people = [replace(e, truth=as_people(e.truth), results=as_people(e.results)) for e in cars]
    overall = check(tmp_path, people, "Pedestrian")
    as_cars = evaluate_protocol("kitti2d", cars)["overall"]
    assert {key: overall[key] for key in FIELDS} == {key: as_cars[key] for key in FIELDS}
    assert overall["TP"] > 5


@pytest.mark.parametrize(
    ("name", "classes"),
    [
        ("kitti2d", ("Cyclist",)),
        ("hota", ("Cyclist",)),
        ("kitti3d", ("Tram",)),
        ("kitti3d", ("Van",)),
        ("kitti3d", ("Car", "Pedestrian")),
        ("kitti2d", ("Pedestrian", "Van")),
    ],
)
def test_classes_that_a_protocol_is_not_defined_for(name, classes):
    with pytest.raises(InputError, match=f"--classes: {name} evaluates one class of Car, Ped"):
        evaluate_protocol(name, [random_entry(0)], classes=classes)


def test_equals_trackeval_with_empty_sequences(tmp_path):
    full = random_entry(11, name="0000")
    no_car = Entry("0017", 25, full.truth[full.truth.type == "Pedestrian"], full.results)
    no_result = Entry("0018", 25, random_entry(12).truth, Objects.empty())
    check(tmp_path, [full, no_car, no_result])


def test_dontcare_height_and_van_rules(tmp_path):
    """Five unmatched results of which one counts: the tall one outside the DontCare box."""
    image = [
        [100, 100, 150, 125],  # 25 px high: ignored
        [200, 100, 250, 126],  # 26 px: a false alarm
        [300, 100, 350, 200],  # 51 % in the DontCare box: ignored
        [400, 100, 450, 200],  # half in it: a false alarm, not more than half
        [500, 100, 560, 200],  # lies on a van: ignored
    ]
    solid = [[20, y, 0, 4, 2, 1.5, 0] for y in (-8, -4, 0, 4, 8)]
    nowhere = np.full((2, 7), np.nan)
    regions = rows("DontCare", [0, 0], -1, nowhere, [[324.5, 0, 390, 300], [425, 0, 480, 300]])
    van = rows("Van", [0], 3, [solid[4]], [image[4]])
    car = rows("Car", [0], 4, [[40, 0, 0, 4, 2, 1.5, 0]], [[700, 100, 800, 200]])
    results = rows("Car", [0] * 5, [1, 2, 3, 4, 5], solid, image, score=1.0)
    entry = Entry("0000", 1, Objects.concatenate([regions, van, car]), results)
    overall = check(tmp_path, [entry])
    assert (overall["FP"], overall["FN"], overall["TP"], overall["GT"]) == (2, 1, 0, 1)


@pytest.mark.parametrize(("shift", "expected"), [(0.0, 1.0), (2.0, 1 / 3), (5.0, None)])
def test_localisation_is_averaged_over_thresholds_with_a_match(shift, expected):
    """A car moved along its length by nothing, by half (3-D IoU 1/3), or beyond its box."""
    image = [[700, 100, 800, 200]]
    truth = rows("Car", [0], 1, [[20, 0, 0, 4, 2, 1.5, 0]], image)
    result = rows("Car", [0], 1, [[20 + shift, 0, 0, 4, 2, 1.5, 0]], image, score=1.0)
    overall = evaluate_protocol("hota", [Entry("0000", 1, truth, result)])["overall"]
    assert overall["LocA"] == overall["IDF1"] == 1.0
    assert overall["LocA_3D"] == (expected if expected is None else pytest.approx(expected))


@pytest.mark.real
def test_equals_trackeval_on_real_labels(tmp_path, kitti_root):
    """PointRCNN's boxes linked frame to frame on three sequences, one without any car."""
    from kitti.sequence import open_sequences

    entries = []
    for s in open_sequences(kitti_root, [12, 17, 18]):
        results = linked(kitti_root / "detections" / "pointrcnn_Car" / f"{s.name}.txt")
        entries.append(Entry(s.name, s.num_frames, s.objects, results))
    overall = check(tmp_path, entries)
    assert min(overall[key] for key in ("TP", "FP", "FN", "IDS", "FRAG")) > 0


def linked(path: Path) -> Objects:
    """Detections with ids of the nearest detection of the frame before, where within 2 m."""
    from kitti.detections import read_detections

    detections = read_detections(path)
    ids, fresh = np.full(len(detections), -1), itertools.count()
    for t in range(int(detections.frame.max()) + 1):
        now, before = (np.flatnonzero(detections.frame == f) for f in (t, t - 1))
        for i in now:
            gap = np.linalg.norm(detections.boxes[before, :3] - detections.boxes[i, :3], axis=1)
            free = (gap < 2.0) & ~np.isin(ids[before], ids[now])
            ids[i] = (
                ids[before[np.where(free, gap, np.inf).argmin()]] if free.any() else next(fresh)
            )
    return replace(detections, track_id=ids)


def test_half_of_a_box_in_a_region_is_not_most_of_it():
    boxes = np.array([[0.0, 0, 10, 10], [0, 0, 10, 10.1], [50, 50, 60, 60]])
    regions = np.array([[0.0, 0, 10, 5], [-5, 5, 15, 30]])
    assert boxes_in_dontcare(boxes, regions).tolist() == [False, True, False]
    assert boxes_in_dontcare(boxes, regions[:0]).tolist() == [False] * 3
