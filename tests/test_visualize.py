"""visualize.py: each figure from files, and errors of one line."""

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest
from helpers import two_cars
from helpers.small_weights import write_weights
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

import visualize
from common import flags
from kitti.labels import read_results, write_results
from kitti.objects import Objects
from visualization.drawing import FOUND, TRUTH

FRAMES = 4


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """Sequence 0000 of two cars, and a folder of results that are the truth."""
    folder = two_cars.write_sequence(tmp_path_factory.mktemp("visualize"), frames=FRAMES)
    bbox = np.tile([0.0, 0, 50, 50], (2, 1))
    rows = [
        Objects.from_boxes(t, np.arange(2), two_cars.boxes_at(t), 1.0, bbox=bbox)
        for t in range(FRAMES)
    ]
    write_results(folder / "results" / "0000.txt", Objects.concatenate(rows))
    return folder


def run(root, figure, out, *more) -> int:
    argv = [figure, "--data_root", root, "--seq", "0000", "--out", out, *more]
    return flags.run(visualize.main, [str(word) for word in argv])


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_birds_eye_of_a_frame(root, tmp_path, capsys, suffix):
    out = tmp_path / f"a{suffix}"
    assert run(root, "birds_eye", out, "--results", root / "results", "--frame", 1) == 0
    assert capsys.readouterr().out.strip() == str(out)
    assert out.stat().st_size > 1000


def test_trajectories_have_a_row_per_folder_of_results(root, tmp_path):
    sizes = []
    for count in (1, 2):
        out = tmp_path / f"{count}.png"
        distances = ",".join(["0", "2"][:count])
        results = ["--results", *[root / "results"] * count]
        assert run(root, "trajectories", out, *results, "--displacements", distances) == 0
        sizes.append(Image.open(out).size)
    (width, height), two = sizes
    assert two[0] == width and 1.8 < two[1] / height < 2


@pytest.mark.parametrize(
    ("shifts", "endings"),
    [
        ([], ["results", "results (2)"]),
        (["--object_shift", "2"], ["shifted by up to 2 m"] * 2),
        (["--object_shift", "0,2"], ["results", "results (2), objects shifted by up to 2 m"]),
    ],
)
def test_rows_of_trajectories_are_named(root, tmp_path, monkeypatch, shifts, endings):
    seen = []

    def keep(_, titles) -> Figure:
        seen.extend(titles)
        return Figure()

    monkeypatch.setattr(visualize, "trajectories", keep)
    results = ["--results", root / "results", root / "results"]
    assert run(root, "trajectories", tmp_path / "a.png", *results, *shifts) == 0
    assert len(seen) == 2
    assert all(title.endswith(end) for title, end in zip(seen, endings, strict=True))


def test_scene_of_two_folders_of_results(root, tmp_path, capsys):
    out = tmp_path / "a.html"
    results = ["--results", root / "results", root / "results"]
    assert run(root, "scene", out, *results, "--points", 50) == 0
    assert capsys.readouterr().out.strip() == str(out)
    text = out.read_text(encoding="utf-8")
    (data,) = re.findall(r'<script type="application/json" id="scene">(.*?)</script>', text)
    scene = json.loads(data)
    assert scene["frames"] == len(scene["points"]["frames"]) == FRAMES
    assert [len(base64.b64decode(frame)) for frame in scene["points"]["frames"]] == [7 * 50] * 4
    assert [tracker["name"] for tracker in scene["trackers"]] == ["results", "results (2)"]
    boxes = np.frombuffer(base64.b64decode(scene["trackers"][0]["box"]["data"]), "<f4")
    expected = read_results(root / "results" / "0000.txt", FRAMES).boxes
    np.testing.assert_array_equal(boxes, expected.ravel().astype("f4"))


def test_scene_of_labels_alone_under_an_object_shift(root, tmp_path):
    out = tmp_path / "a.html"
    assert run(root, "scene", out, "--object_shift", 2) == 0
    assert "objects shifted by up to 2 m</title>" in out.read_text(encoding="utf-8")


def test_names_of_trackers():
    folders = [Path("/r/sort/tracks"), Path("/r/ours"), Path("/q/sort/tracks")]
    assert visualize.tracker_names(folders) == ["sort", "ours", "sort (2)"]


@pytest.mark.slow
def test_network_and_foreground_of_small_networks(root, tmp_path):
    weights = write_weights(tmp_path / "weights")
    out = tmp_path / "pictures"
    assert run(root, "network", out, "--weights", weights, "--frame", 2) == 0
    names = ["association.png", "network.html", "sampling.png"]
    assert sorted(path.name for path in out.iterdir()) == names
    text = (out / "network.html").read_text(encoding="utf-8")
    (data,) = re.findall(r'<script type="application/json" id="scene">(.*?)</script>', text)
    network = json.loads(data)["network"]
    arrows = network["arrows"]
    assert len(arrows["from"]["data"]) == len(arrows["by"]["data"]) > 0
    assert len(network["group"]["neighbors"]) > 0
    proposals = network["proposals"]
    owners = np.frombuffer(base64.b64decode(proposals["owner"]["data"]), "<i4")
    scores = np.frombuffer(base64.b64decode(proposals["score"]["data"]), "<f4")
    assert len(owners) == len(scores) > 0 and owners.max() >= 0
    drive = tmp_path / "a.html"
    assert run(root, "scene", drive, "--foreground", "--weights", weights) == 0
    assert '"shading":"foreground probability"' in drive.read_text(encoding="utf-8")


def test_animation_has_every_frame(root, tmp_path):
    out = tmp_path / "a.gif"
    assert run(root, "animation", out, "--results", root / "results") == 0
    assert Image.open(out).n_frames == FRAMES


@pytest.mark.parametrize(
    ("figure", "name", "more", "message"),
    [
        ("birds_eye", "a.gif", ("--results", "R"), "expected a file ending in .png, .pdf, .svg"),
        ("animation", "a.png", ("--results", "R"), "expected a file ending in .gif"),
        (
            "trajectories",
            "a.png",
            ("--results", "R", "R", "R", "--object_shift", "0,2"),
            "--object_shift: expected 1 or 3 values, found 2",
        ),
        ("scene", "a.png", (), "expected a file ending in .html"),
        ("scene", "a.html", ("--iou", "0"), "--iou: expected above 0 and at most 1, found 0"),
        ("scene", "a.html", ("--rerun", "a.txt"), "--rerun: expected a file ending in .rrd"),
        ("scene", "a.html", ("--object_shift", "1e6"), "--object_shift: expected 0 to 1000 metres"),
        ("scene", "a.html", ("--results", "none"), "0000.txt"),
        ("scene", "a.html", ("--foreground", "--weights", "none"), "detector.npz: expected a"),
        ("birds_eye", "a.png", ("--results", "R", "--frame", "4"), "--frame: expected 0 to 3"),
        ("birds_eye", "a.png", ("--results", "none"), "0000.txt"),
        ("birds_eye", "a.png", ("--results", "R", "--seq", "0000-0001"), "expected one sequence"),
        ("network", "pictures", ("--frame", "0"), "frame 0: expected a scan there and in the"),
        ("network", "pictures", ("--weights", "none"), "detector.npz: expected a checkpoint"),
    ],
)
def test_invalid_input_gives_one_line(root, tmp_path, capsys, figure, name, more, message):
    words = [root / "results" if word == "R" else word for word in more]
    assert run(root, figure, tmp_path / name, *words) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and message in error
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_labels_alone(root, tmp_path):
    assert run(root, "birds_eye", tmp_path / "a.png", "--frame", 1) == 0
    with Image.open(tmp_path / "a.png") as picture:
        colors = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    truth, found = (np.round(255 * np.array(to_rgb(c))) for c in (TRUTH, FOUND))
    assert (colors == truth).all(1).any() and not (colors == found).all(1).any()
    assert run(root, "animation", tmp_path / "a.gif") == 0
    assert Image.open(tmp_path / "a.gif").n_frames == FRAMES


def test_trajectories_need_results(root, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        run(root, "trajectories", tmp_path / "a.png")
    assert "required: --results" in capsys.readouterr().err
