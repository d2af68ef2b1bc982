"""Contents of every picture: axes in metres, boxes, lines, colours by id."""

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, ConnectionPatch
from matplotlib.text import Text
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from PIL import Image

from kitti.objects import Objects
from visualization.animation import animate, palette
from visualization.association import Neighborhood, association
from visualization.birds_eye import BirdsEye, birds_eye, view_of
from visualization.clip import Clip
from visualization.drawing import FOUND, ON_DARK, ON_WHITE, TRUTH, id_color, outlines, save
from visualization.gallery import sequence_title
from visualization.sampling import Samplings, sampling, share_in_boxes
from visualization.trajectories import SPAN, trajectories

FRAMES = 6


def _objects(count: int, shift: float = 0.0) -> Objects:
    """`count` cars side by side that move 1 m a frame."""
    parts = []
    for t in range(FRAMES):
        boxes = np.tile([10.0 + t + shift, 0, 0, 4, 1.8, 1.5, 0], (count, 1))
        boxes[:, 1] = 4 * np.arange(count)
        parts.append(Objects.from_boxes(t, np.arange(count), boxes, 1.0))
    return Objects.concatenate(parts)


def _points(t: int):
    rng = np.random.default_rng(t)
    return None if t == 2 else rng.uniform((0, -20, -2), (60, 20, 1), (300, 3)).astype(np.float32)


@pytest.fixture
def clip() -> Clip:
    return Clip("0016", range(FRAMES), _points, _objects(3, 0.2), _objects(2))


def _collections(panel, kind=LineCollection):
    return [artist for artist in panel.collections if isinstance(artist, kind)]


def _legend(figure) -> list[str]:
    """The words of the one legend, which lies below the panels."""
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def _rgba(color):
    from matplotlib.colors import to_rgba

    return to_rgba(color)


def test_the_busiest_frame_is_in_the_second_half_of_the_shown_ones():
    cars = _objects(3)
    rows = (cars.frame != 4) | (cars.track_id == 0)
    clip = Clip("0016", range(1, FRAMES), _points, cars[rows], Objects.empty())
    assert clip.busiest_frame() == 3


def test_birds_eye_shows_truth_dotted_and_prediction_solid(clip, tmp_path):
    figure = birds_eye(clip, 5)
    (panel,) = figure.axes
    assert panel.get_xlabel() == "x forward (m)" and panel.get_ylabel() == "y left (m)"
    assert panel.get_aspect() == 1.0
    truth, truth_trails, found, found_trails = _collections(panel)
    assert [len(c.get_segments()) for c in (truth, truth_trails, found, found_trails)] == [
        2, 2, 3, 3,
    ]  # fmt: skip
    for artist, color in ((truth, TRUTH), (truth_trails, TRUTH), (found, FOUND)):
        assert tuple(artist.get_colors()[0]) == _rgba(color)
    assert truth_trails.get_linestyles()[0][1] is not None  # dotted
    assert found_trails.get_linestyles()[0][1] is None  # solid
    assert len(found_trails.get_segments()[0]) == FRAMES
    assert [text.get_text() for text in panel.texts] == ["0", "1", "2"]
    assert _legend(figure) == ["tracks, with ids", "their trails", "truth", "their trails"]
    path = save(figure, tmp_path / "a.png")
    assert np.asarray(Image.open(path).convert("L")).std() > 1


def test_trails_leave_out_the_sensors_own_motion():
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 0, 3] = -np.arange(FRAMES)  # the sensor drives backwards as fast as the cars forwards
    clip = Clip("0016", range(FRAMES), _points, _objects(1), Objects.empty(), poses)
    trail = clip.trails(clip.results, 5, 10)[0]
    # in the level frame of 5: the car at t was at 10 + t - t + 5 in that frame's coordinates
    np.testing.assert_allclose(trail[:, 0], np.full(FRAMES, 15.0))


def test_the_legend_says_what_the_trails_are_relative_to(clip):
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    for known, reference in ((None, "scanner"), (poses, "ground")):
        (legend,) = birds_eye(replace(clip, poses=known), 5).legends
        title = f"trails over the last 30 frames, relative to the {reference}"
        assert legend.get_title().get_text() == title


def test_the_view_holds_the_boxes_and_the_bulk_of_the_points(clip):
    def points(t: int):
        return np.array([[30.0 + t, -11.0, 0]] * 200 + [[500.0, 500, 0]])

    clip = replace(clip, points=points)
    view = view_of(clip, range(FRAMES))
    np.testing.assert_array_equal(view, [[0, 40], [-15, 15]])  # y: a box up to 8.9 m, and its id
    far = _objects(1, 60.0)  # its front is at 10 + 5 + 60 + 2 m in the last frame
    view = view_of(replace(clip, results=far), range(FRAMES))
    np.testing.assert_array_equal(view[0], [0, 80])


def test_all_frames_have_one_view_and_the_figure_its_shape(clip):
    view = BirdsEye(clip, clip.frames)
    limits = [(p.get_xlim(), p.get_ylim()) for t in (0, 5) for p in view.draw(t).axes]
    assert limits[0] == limits[1] == tuple(map(tuple, view_of(clip, clip.frames)))
    road = replace(clip, points=lambda t: np.array([[60.0, 0, 0]] * 100))
    assert birds_eye(road, 5).get_figheight() < 0.7 * view.figure.get_figheight()


def test_boxes_without_numbers_do_not_spoil_the_view(clip):
    objects = _objects(1)
    nowhere = Objects.from_boxes(0, np.arange(1), np.full((1, 7), np.nan), 1.0)
    odd = replace(clip, results=Objects.concatenate([nowhere, objects]))
    assert np.isfinite(view_of(odd, range(FRAMES))).all()


def test_outline_has_a_stroke_to_the_front():
    (outline,) = outlines(np.array([[0, 0, 0, 4, 2, 1, 0.0]]))
    np.testing.assert_allclose(outline[-1], [2, 0], atol=1e-12)
    assert np.abs(outline).max() == 2


def test_sampling_has_a_panel_per_layer(clip):
    rng = np.random.default_rng(0)
    sets = [rng.uniform(-5, 50, (n, 3)) for n in (300, 32, 300, 32)]
    samplings = Samplings(("TRA_SA1", "TRA_SA3"), tuple(sets[:2]), tuple(sets[2:]))
    figure = sampling(samplings, _points(0), clip.truth.at(0).boxes)
    assert [panel.get_title() for panel in figure.axes] == [
        "TRA_SA1: 300 points", "TRA_SA3: 32 points",
    ]  # fmt: skip
    for panel, count in zip(figure.axes, (300, 32), strict=True):
        scan, plain, filtered = panel.lines
        assert len(scan.get_xdata()) == 300
        assert (plain.get_color(), filtered.get_color()) == ("tab:red", "tab:green")
        assert len(plain.get_xdata()) == len(filtered.get_xdata()) == count
        assert len(_collections(panel)[0].get_segments()) == 2
    assert _legend(figure) == [
        "farthest points of the whole scan", "after the probability filter", "true vehicles",
    ]  # fmt: skip


def test_share_in_boxes():
    box = np.array([[0, 0, 0, 2, 2, 2, 0.0]])
    assert share_in_boxes(np.array([[0.0, 0, 0], [5, 0, 0], [0.5, 0, 0], [9, 9, 9]]), box) == 0.5
    assert share_in_boxes(np.zeros((0, 3)), box) == 0.0


def test_association_shows_the_group_of_the_chosen_point():
    rng = np.random.default_rng(0)
    previous, current = rng.normal(size=(20, 3)), rng.normal(size=(20, 3))
    group = np.array([1, 4, 5, 5])  # one repeated: three different points
    view = Neighborhood(previous, current, 7, group, 5.0)
    figure = association(view, np.zeros((0, 7)), np.zeros((0, 7)))
    left, right = figure.axes
    np.testing.assert_allclose(left.collections[-1].get_offsets()[0], previous[7, :2])
    solid = right.collections[-2].get_offsets()
    np.testing.assert_allclose(np.sort(solid, 0), np.sort(current[[1, 4, 5], :2], 0))
    lines = [artist for artist in figure.artists if isinstance(artist, ConnectionPatch)]
    assert len(lines) == 3
    (circle,) = (patch for patch in right.patches if isinstance(patch, Circle))
    assert circle.radius == 5.0
    assert "its nearest points, up to 4 within 5 m" in _legend(figure)
    assert {"points of frame A", "points of frame B"} < set(_legend(figure))
    assert right.get_ylabel() == ""  # the lines to the group pass there


def test_trajectories_have_a_row_per_clip_and_a_colour_per_id(clip):
    figure = trajectories([clip, clip], ["D = 0", "D = 2 m"])
    assert [panel.get_title() for panel in figure.axes] == ["D = 0 (3 ids)", "D = 2 m (3 ids)"]
    for panel in figure.axes:
        lines = panel.lines[1:]  # the first is the scan
        assert [line.get_color() for line in lines] == [id_color(i) for i in range(3)]
        assert len(panel.collections) == 3
        assert all(isinstance(artist, Line3DCollection) for artist in panel.collections)
        assert panel.get_xlabel() == "x forward (m)"
    assert _legend(figure) == ["tracks over the last 60 frames", "their boxes every 20 frames"]


def test_ids_are_not_written_over_each_other():
    count = 30
    boxes = np.tile([20.0, 3, 0, 4, 1.8, 1.5, 0], (count, 1))
    boxes[:, 0] += np.linspace(0, 1, count)
    cars = Objects.from_boxes(SPAN, np.arange(count), boxes, 1.0)
    figure = trajectories([Clip("0016", range(SPAN + 1), _points, cars, Objects.empty())], [""])
    figure.draw_without_rendering()
    (panel,) = figure.axes
    assert sorted(int(text.get_text()) for text in panel.texts) == list(range(count))
    words = [Text.get_window_extent(text) for text in panel.texts]
    assert not any(a.overlaps(b) for a, b in combinations(words, 2))


@pytest.mark.parametrize(
    ("colors", "truth"), [(ON_WHITE, TRUTH), (ON_DARK, tuple(x / 255 for x in (70, 214, 110)))]
)
def test_ids_differ_from_each_other_from_labels_and_from_points(colors, truth):
    rgb = np.array([_rgba(id_color(i, colors))[:3] for i in range(len(colors) + 1)])
    assert len(colors) == 20 and (rgb[0] == rgb[20]).all()
    assert np.linalg.norm(np.diff(rgb, axis=0), axis=1).min() > 0.5
    assert min(np.linalg.norm(a - b) for a, b in combinations(rgb[:20], 2)) > 0.19
    assert np.linalg.norm(rgb - _rgba(truth)[:3], axis=1).min() > 0.36
    assert np.ptp(rgb, axis=1).min() > 0.25  # none is grey


def test_greys_stay_grey_and_colours_pure_in_an_animation():
    greys = np.repeat(np.arange(256, dtype=np.uint8), 3).reshape(1, -1, 3)
    pure = [[255 * x for x in _rgba(color)[:3]] for color in (TRUTH, *ON_WHITE)]
    pure = np.array([pure]).round().astype(np.uint8)
    shown = [
        np.asarray(Image.fromarray(x).quantize(palette=palette(), dither=0).convert("RGB"), int)
        for x in (greys, pure)
    ]
    assert np.ptp(shown[0], axis=2).max() == 0 and shown[0][0, 255, 0] == 255
    assert np.abs(shown[0] - greys).max() <= 8
    assert np.abs(shown[1] - pure).max() <= 4


def test_the_title_names_results_and_shift_where_there_are_any():
    assert sequence_title("0016", 0.0) == "sequence 0016"
    expected = "sequence 0016, sort, objects shifted by up to 0.5 m"
    assert sequence_title("0016", 0.5, "sort") == expected


def test_words_are_readable_on_a_phone(clip):
    """A picture as wide as a phone (360 px) has letters of at least 7 px."""
    for figure in (birds_eye(clip, 5), trajectories([clip], ["D = 0"])):
        points = [t.get_fontsize() for panel in figure.axes for t in (*panel.texts, panel.title)]
        assert min(points) / 72 * 360 / figure.get_figwidth() > 7


def test_animation_has_a_picture_per_frame(clip, tmp_path):
    ticks = []
    path = animate(clip, tmp_path / "a.gif", max_frames=4, each_frame=lambda: ticks.append(1))
    image = Image.open(path)
    assert image.n_frames == 4 == len(ticks)
    assert image.info["loop"] == 0 and image.info["duration"] == 100
    frames = []
    for t in range(4):
        image.seek(t)
        frames.append(np.asarray(image.convert("RGB"), int))
    assert all(np.abs(a - b).max() > 50 for a, b in pairwise(frames))


def test_pictures_of_nothing_are_drawn():
    nothing = Clip("0000", range(2), lambda t: None, Objects.empty(), Objects.empty())
    assert len(birds_eye(nothing, 1).axes) == 1
    assert len(trajectories([nothing], ["empty"]).axes) == 1
    assert nothing.busiest_frame() == 1
