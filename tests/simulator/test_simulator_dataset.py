"""Data sets: layout, same bytes, resume, reuse, refusals; and replay of a labelled set."""

import gzip
import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from common.flags import run
from kitti.boxes import points_in_boxes
from kitti.sequence import KittiSequence, open_sequences
from simulator.__main__ import main

FRAMES = 3


def files(root: Path) -> dict[str, bytes]:
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def own(out: Path, *flags: str) -> list[str]:
    return ["--out", str(out), "--split", "val", "--sequences", "1", "--frames", str(FRAMES),
            "--seed", "5", *flags]  # fmt: skip


def replayed(out: Path, source: Path, *flags: str) -> list[str]:
    return ["--out", str(out), "--from_labels", str(source), "--seqs", "0016", *flags]


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("own") / "data"
    assert run(main, own(out, "--processes", "1")) == 0
    return out


@pytest.fixture(scope="module")
def again(made, tmp_path_factory) -> Path:
    """A replay of the own traffic's labels."""
    out = tmp_path_factory.mktemp("replay") / "data"
    assert run(main, replayed(out, made, "--processes", "1")) == 0
    return out


@pytest.fixture
def kitti_copy(made, tmp_path) -> Path:
    """The text files of the own traffic, which a test may change."""
    for path in (*made.glob("training/*/0016.txt"), *made.glob("poses/*.txt")):
        copy = tmp_path / "source" / path.relative_to(made)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes())
    return tmp_path / "source"


def test_kitti_reads_it_with_no_special_case(made):
    (sequence,) = open_sequences(made, [16])
    assert sequence.num_frames == FRAMES and len(sequence.pairs()) == FRAMES - 1
    assert sequence.poses.shape == (FRAMES, 4, 4)
    labelled = sequence.objects[sequence.objects.type != "DontCare"]
    assert len(labelled) > 3 and np.isfinite(labelled.boxes).all()
    assert set(np.unique(labelled.occlusion)) <= {0, 1, 2}
    points = sequence.read_points_level(0)
    uncropped = sequence.read_points_level(0, crop=False)
    assert 8000 < len(points) < 25000 and len(points) == len(uncropped)
    manifest = json.loads((made / "manifest.json").read_text())
    assert manifest["complete"] is True and manifest["seed"] == 5 and manifest["version"] >= 1
    assert manifest["sensor"]["azimuth_step_deg"] == pytest.approx(0.1798)


def test_oxts_are_the_motion_of_the_imu(made):
    sequence = KittiSequence(made, 16)
    rows = np.loadtxt(made / "training/oxts/0016.txt")
    assert rows.shape == (FRAMES, 30)
    imu = np.tile(np.eye(4), (FRAMES, 1, 1))  # in a Mercator projection, as the devkit has it
    imu[:, :3, :3] = Rotation.from_euler("ZYX", rows[:, [5, 4, 3]]).as_matrix()
    scale = 6378137.0 * np.cos(np.radians(rows[0, 0]))
    imu[:, 0, 3] = scale * np.radians(rows[:, 1])
    imu[:, 1, 3] = scale * np.log(np.tan(np.radians(90 + rows[:, 0]) / 2))
    imu[:, 2, 3] = rows[:, 2]
    velo_from_imu = np.vstack([sequence.calib.tr_imu_to_velo, [0, 0, 0, 1]])
    level_from_imu = sequence.calib.level_from_velo @ velo_from_imu
    assert np.abs(level_from_imu[:3, 3]).max() > 0.5  # another place than the camera's
    found = level_from_imu @ np.linalg.inv(imu[0]) @ imu @ np.linalg.inv(level_from_imu)
    np.testing.assert_allclose(found, np.linalg.inv(sequence.poses[0]) @ sequence.poses, atol=1e-4)
    assert abs(rows[-1, 8] - np.linalg.norm(imu[-1, :3, 3] - imu[-2, :3, 3]) / 0.1) < 0.5


def test_labels_hold_the_points_of_their_objects(made):
    sequence = KittiSequence(made, 16)
    now = sequence.objects.at(1).of_classes(("Car", "Van", "Truck"))
    owner = points_in_boxes(sequence.read_points_level(1), now.boxes, 0.1)
    visible = np.flatnonzero((now.occlusion == 0) & (now.boxes[:, 0] < 30))
    for row in visible:
        assert (owner == row).sum() >= 10


def test_track_ids_never_change(made):
    objects = KittiSequence(made, 16).objects
    objects = objects[objects.type != "DontCare"]
    for track in np.unique(objects.track_id):
        rows = objects[objects.track_id == track]
        assert len(set(rows.type)) == 1 and len(set(rows.frame)) == len(rows)
        np.testing.assert_allclose(rows.boxes[:, 3:6].std(axis=0), 0, atol=1e-5)


def test_bytes_do_not_depend_on_the_number_of_processes(again, made, tmp_path, monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    before = dict(os.environ)
    out = tmp_path / "data"
    assert run(main, replayed(out, made, "--processes", "2")) == 0
    assert files(out) == files(again)
    assert dict(os.environ) == before


def test_an_interrupted_run_resumes(again, made, tmp_path):
    out = tmp_path / "data"
    assert run(main, replayed(out, made, "--processes", "1")) == 0
    manifest = json.loads((out / "manifest.json").read_text())
    (out / "manifest.json").write_text(json.dumps({**manifest, "complete": False}))
    scans = sorted((out / "training/velodyne/0016").glob("*.bin"))
    kept = scans[0].stat().st_mtime_ns
    scans[1].unlink()
    (out / "training/label_02/0016.txt").unlink()
    assert run(main, replayed(out, made, "--processes", "1")) == 0
    assert scans[0].stat().st_mtime_ns == kept
    assert files(out) == files(again)


def test_own_traffic_gives_the_same_bytes_again(made, tmp_path):
    out = tmp_path / "data"
    assert run(main, own(out, "--processes", "1")) == 0
    assert files(out) == files(made)
    (out / "training/label_02/0016.txt").unlink()  # as if interrupted before the labels
    assert run(main, own(out, "--processes", "1")) == 0
    assert files(out) == files(made)


def test_a_finished_folder_is_recognised(again, made, capsys):
    before = {path: path.stat().st_mtime_ns for path in again.rglob("*")}
    assert run(main, replayed(again, made)) == 0
    assert "already there" in capsys.readouterr().out
    assert before == {path: path.stat().st_mtime_ns for path in again.rglob("*")}


def test_replayed_labels_equal_the_source(again, made):
    for folder in ("label_02", "calib"):
        source, copy = (root / "training" / folder / "0016.txt" for root in (made, again))
        assert source.read_bytes() == copy.read_bytes()
    np.testing.assert_array_equal(
        KittiSequence(made, 16).objects.boxes, KittiSequence(again, 16).objects.boxes
    )


def test_a_source_with_a_fault_is_refused_before_anything_is_written(tmp_path, kitti_copy, capsys):
    out = tmp_path / "x"
    seqmap = kitti_copy / "training" / "evaluate_tracking.seqmap.training"
    seqmap.write_text("0016 empty 000001 000002\n")
    assert run(main, replayed(out, kitti_copy)) == 2
    assert "sequence 0016 begins at frame 1 by its seqmap, expected 0" in capsys.readouterr().err
    seqmap.unlink()
    (kitti_copy / "training" / "calib" / "0016.txt").write_text("P2: 1\n")
    assert run(main, replayed(out, kitti_copy)) == 2
    assert "P2: expected 12 numbers" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("file", ["training/label_02", "training/calib", "poses"])
def test_a_replay_of_a_changed_source_is_another_data_set(file, tmp_path, kitti_copy, capsys):
    flags = replayed(tmp_path / "x", kitti_copy, "--frames", "1", "--processes", "1")
    assert run(main, flags) == 0
    path = kitti_copy / file / "0016.txt"
    text = path.read_text().rstrip()
    path.write_text(text[:-1] + ("2" if text[-1] == "1" else "1") + "\n")
    capsys.readouterr()
    assert run(main, flags) == 2
    name = f"{file.removeprefix('training/')}/0016"
    assert f"another data set (differs in {name});" in capsys.readouterr().err
    path.unlink()
    assert run(main, flags) == 2


def test_a_finished_replay_is_recognised_under_another_path_of_its_source(
    again, made, monkeypatch, capsys
):
    before = (again / "manifest.json").read_bytes()
    monkeypatch.chdir(made.parent)
    assert run(main, replayed(again, Path(made.name))) == 0
    assert "already there" in capsys.readouterr().out
    assert (again / "manifest.json").read_bytes() == before
    assert json.loads(before)["spec"]["from_labels"] == str(made)
    assert run(main, replayed(again, Path(made.name), "--frames", "1")) == 2
    assert "(differs in frames)" in capsys.readouterr().err


def test_a_message_names_few_of_many_differences(made, again, capsys):
    assert run(main, replayed(made, made)) == 2
    assert "(differs in driver, seed, label_02/0016, calib/0016, ...)" in capsys.readouterr().err


def test_files_of_killed_runs_are_removed(again, made, tmp_path):
    out = tmp_path / "data"
    flags = replayed(out, made, "--processes", "1")
    killed_at_once = out / ".manifest-ab_d12x9.json"
    out.mkdir()
    killed_at_once.write_text("{")
    assert run(main, flags) == 0 and files(out) == files(again)
    folder = out / "training" / "velodyne" / "0016"
    mine = folder / ".000000-notes.bin"
    for path in (folder / ".000000-ab_d12x9.bin", out / "poses" / ".0016-ab_d12x9.txt", mine):
        path.write_bytes(b"half")
    (folder / "000000.bin").unlink()
    assert run(main, flags) == 0
    mine.unlink()
    assert files(out) == files(again)


def test_a_folder_with_more_than_a_killed_manifest_is_left_alone(made, tmp_path):
    for name in (".manifest-ab_d12x9.json", "mine.txt"):
        (tmp_path / name).write_text("{")
    assert run(main, replayed(tmp_path, made)) == 2
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(
    "file",
    ["poses/0016.txt", "training/oxts/0016.txt", "training/evaluate_tracking.seqmap.training"],
)
def test_a_lost_file_is_made_again(file, again, made):
    before = files(again)
    (again / file).unlink()
    assert run(main, replayed(again, made, "--processes", "1")) == 0
    assert files(again) == before


def test_a_replay_without_poses_is_complete_without_them(tmp_path, kitti_copy, capsys):
    (kitti_copy / "poses" / "0016.txt").unlink()
    flags = replayed(tmp_path / "x", kitti_copy, "--frames", "1", "--processes", "1")
    assert run(main, flags) == 0 and run(main, flags) == 0
    assert "already there" in capsys.readouterr().out


def test_packed_labels_are_replayed(tmp_path, kitti_copy, again):
    labels = kitti_copy / "training" / "label_02" / "0016.txt"
    labels.with_name("0016.txt.gz").write_bytes(gzip.compress(labels.read_bytes()))
    labels.unlink()
    out = tmp_path / "x"
    assert run(main, replayed(out, kitti_copy, "--frames", "1", "--processes", "1")) == 0
    copied = (out / "training" / "label_02" / "0016.txt").read_text().splitlines()
    whole = (again / "training" / "label_02" / "0016.txt").read_text().splitlines()
    assert copied == [line for line in whole if line.startswith("0 ")]


def test_replay_of_fewer_frames_is_whole(made, tmp_path):
    out = tmp_path / "data"
    assert run(main, replayed(out, made, "--frames", "2", "--processes", "1")) == 0
    sequence = KittiSequence(out, 16)
    assert sequence.num_frames == 2 and sequence.objects.frame.max() == 1
    assert len(sequence.poses) == 2


def test_each_option_has_its_effect(again, made, tmp_path):
    around, moving = tmp_path / "full", tmp_path / "moving"
    assert run(main, replayed(around, made, "--frames", "2", "--full", "--processes", "1")) == 0
    flags = ("--frames", "2", "--motion_distortion", "--processes", "1")
    assert run(main, replayed(moving, made, *flags)) == 0
    whole = KittiSequence(around, 16).read_points_level(1, crop=False)
    assert (whole[:, 0] < -5).sum() > 5000 and len(whole) > 60000
    still = KittiSequence(again, 16).read_points_level(1)
    distorted = KittiSequence(moving, 16).read_points_level(1)
    assert not np.array_equal(still, distorted)
    assert len(distorted) == pytest.approx(len(still), rel=0.05)


@pytest.mark.parametrize(
    ("flags", "word"),
    [
        (["--sequences", "99"], "--sequences"),
        (["--seqs", "0016"], "--seqs"),
        (["--from_labels", "nowhere"], "--seqs"),
        (["--from_labels", "nowhere", "--seqs", "0016"], "nowhere"),
        (["--from_labels", "nowhere", "--seqs", "0016", "--split", "val"], "--split"),
        (["--from_labels", "nowhere", "--seqs", "0016", "--van_share", "0.3"], "--van_share"),
    ],
)
def test_flags_that_do_not_fit(flags, word, tmp_path, capsys):
    assert run(main, ["--out", str(tmp_path / "x"), *flags]) == 2
    error = capsys.readouterr().err
    assert word in error and error.count("\n") == 1
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    "flags",
    [["--frames", "0"], ["--seed", "-1"], ["--split", "test"], ["--van_share", "0.95"]],
)
def test_flags_that_are_wrong(flags, tmp_path, capsys):
    with pytest.raises(SystemExit) as caught:
        main(["--out", str(tmp_path / "x"), *flags])
    assert caught.value.code == 2
    assert flags[0] in capsys.readouterr().err


def test_a_file_is_no_folder(tmp_path, capsys):
    out = tmp_path / "data"
    out.write_text("dear")
    assert run(main, own(out)) == 2
    assert f"error: {out}: expected a folder, found a file\n" == capsys.readouterr().err
    assert out.read_text() == "dear"


def test_folders_of_others_are_left_alone(again, made, tmp_path, capsys):
    assert run(main, replayed(again, made, "--seed", "9")) == 2
    assert "another data set" in capsys.readouterr().err
    (tmp_path / "mine.txt").write_text("dear")
    assert run(main, replayed(tmp_path, made)) == 2
    assert "manifest.json" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "manifest.json").write_text("{")
    assert run(main, replayed(broken, made)) == 2
    assert "JSON" in capsys.readouterr().err
