"""evaluate.py on a fake testing subset writes the submission for the KITTI server."""

import zipfile

import numpy as np
import pytest
from helpers import tiny_kitti
from helpers.small_weights import write_weights

import evaluate
from common import flags
from evaluation.submission import write_submission
from kitti.calibration import write_calibration
from kitti.labels import read_results
from kitti.scans.scan_files import write_scan
from kitti.seqmap import TEST


@pytest.fixture(scope="module")
def testing_root(tmp_path_factory):
    """29 sequences of two small scans, without labels, as KITTI's testing subset."""
    root = tmp_path_factory.mktemp("testing_tree")
    rng = np.random.default_rng(0)
    for seq in TEST:
        write_calibration(root / "testing" / "calib" / f"{seq:04d}.txt", tiny_kitti.CALIB)
        for t in range(2):
            points = rng.uniform((5, -5, -1.7, 0), (40, 5, 1, 1), (300, 4))
            write_scan(root / "testing" / "velodyne" / f"{seq:04d}" / f"{t:06d}.bin", points)
    return root


@pytest.mark.slow
def test_all_29_sequences_are_in_the_zip(testing_root, tmp_path, capsys):
    weights = write_weights(tmp_path / "weights")
    argv = ["--data_root", testing_root, "--subset", "testing", "--detections", "network"]
    argv += ["--tracker", "pointtracknet", "--weights", weights, "--out", tmp_path / "out"]
    assert flags.run(evaluate.main, [str(a) for a in argv]) == 0
    assert "submission.zip (complete)" in capsys.readouterr().out
    with zipfile.ZipFile(tmp_path / "out" / "submission.zip") as archive:
        assert archive.namelist() == [f"{seq:04d}.txt" for seq in TEST]  # 29 at the root
        assert archive.testzip() is None
        rows = 0
        for name in archive.namelist():
            data = archive.read(name)
            assert data == (tmp_path / "out" / "tracks" / name).read_bytes()
            results = read_results(tmp_path / "out" / "tracks" / name, 2)
            rows += len(results)
            assert (results.bbox >= 0).all()  # -1 would switch the server's 2-D off
    assert rows > 0


def test_the_same_results_give_the_same_bytes(tmp_path):
    files = []
    for name in ("0001.txt", "0000.txt"):
        files.append(tmp_path / name)
        files[-1].write_text(name)
    write_submission(tmp_path / "a.zip", files)
    write_submission(tmp_path / "b.zip", files[::-1])
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        assert archive.namelist() == ["0000.txt", "0001.txt"]
