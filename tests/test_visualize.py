"""visualize.py draws from files what it is asked for, and says in one line what does not fit."""

import numpy as np
import pytest
from PIL import Image
from small_inputs import two_cars

import visualize
from common import flags
from kitti.labels import Objects, write_results

FRAMES = 4


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """Sequence 0000 of two cars, and a folder of results that are the truth."""
    cars = two_cars()
    folder = cars.write_sequence(tmp_path_factory.mktemp("visualize"), frames=FRAMES)
    bbox = np.tile([0.0, 0, 50, 50], (2, 1))
    rows = [
        Objects.from_boxes(t, np.arange(2), cars.boxes_at(t), 1.0, bbox=bbox) for t in range(FRAMES)
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
    assert two[0] == width and two[1] == pytest.approx(2 * height, abs=2)


def test_animation_has_every_frame(root, tmp_path):
    out = tmp_path / "a.gif"
    assert run(root, "animation", out, "--results", root / "results") == 0
    assert Image.open(out).n_frames == FRAMES


@pytest.mark.parametrize(
    ("figure", "name", "more", "message"),
    [
        ("birds_eye", "a.gif", ("--results", "R"), "expected a file ending in .png, .pdf, .svg"),
        ("animation", "a.png", ("--results", "R"), "expected a file ending in .gif"),
        ("birds_eye", "a.png", (), "expected as many --results as --displacements"),
        ("birds_eye", "a.png", ("--results", "R", "--frame", "4"), "--frame: expected below 4"),
        ("birds_eye", "a.png", ("--results", "none"), "0000.txt"),
        ("birds_eye", "a.png", ("--results", "R", "--seq", "0000-0001"), "expected one sequence"),
        ("network", "pictures", ("--frame", "0"), "frame 0: expected a scan there and in the"),
        ("network", "pictures", ("--weights", "none"), "detector.npz: expected a checkpoint"),
    ],
)
def test_what_does_not_fit_is_one_line(root, tmp_path, capsys, figure, name, more, message):
    words = [root / "results" if word == "R" else word for word in more]
    assert run(root, figure, tmp_path / name, *words) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and message in error
    assert not (tmp_path / "a.png").exists()
