"""The scene in headless Chromium: no error, not blank, slider, hover, views, strip."""

from io import BytesIO

import numpy as np
import pytest
from helpers import chromium
from PIL import Image
from test_scene import FRAMES, drive, points

from kitti.objects import Objects
from visualization.clip import Clip
from visualization.scene import scene_data
from visualization.scene_page import write_scene

pytestmark = [
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium or Chrome is installed"),
    pytest.mark.slow,
]
DRAWN = "typeof scene !== 'undefined' && scene.draws() > 0"


@pytest.fixture(scope="module")
def browser():
    with chromium.Chromium() as opened:
        yield opened


def show(browser, path, clip, trackers):
    """Opens the scene of a clip; earlier errors are cleared."""
    write_scene(path, "a drive", scene_data(clip, trackers))
    browser.errors.clear()
    browser.requests.clear()
    browser.open(path)
    browser.wait_for(DRAWN, 60)


def pixels(browser) -> np.ndarray:
    return np.asarray(Image.open(BytesIO(browser.screenshot())).convert("RGB"), int)


def settle(browser, script: str) -> None:
    """Runs a script and waits for the picture after it."""
    before = browser.evaluate("scene.draws()")
    browser.evaluate(script)
    browser.wait_for(f"scene.draws() > {before}")
    browser.evaluate("new Promise((done) => requestAnimationFrame(() => setTimeout(done, 100)))")


def overlapping_words(browser) -> int:
    """The number of pairs of words above boxes of which one covers a part of the other."""
    return browser.evaluate(
        "(() => { const r = [...document.querySelectorAll('#words b')]"
        ".map((word) => word.getBoundingClientRect());"
        "return r.flatMap((a, i) => r.slice(i + 1).filter((b) => a.left < b.right - 1"
        " && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1)).length; })()"
    )


@pytest.fixture
def clip() -> Clip:
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 0, 3] = np.arange(FRAMES)
    return Clip("0016", range(FRAMES), points, Objects.empty(), drive([3, 4]), poses)


def test_slider_hover_and_views(browser, clip, tmp_path):
    results = drive([3, 77], 0.1)
    results = results[(results.frame != 2) | (results.track_id == 3)]
    show(browser, tmp_path / "a.html", clip, {"ours": results})
    first = pixels(browser)
    assert first[:600].std() > 5
    slider = "document.getElementById('slider')"
    settle(browser, f"{slider}.value = 4; {slider}.dispatchEvent(new Event('input'))")
    assert browser.evaluate("document.querySelector('output').textContent") == "frame 4 of 0-4"
    assert np.abs(pixels(browser)[:600] - first[:600]).mean() > 0.5

    place = browser.evaluate(
        "(() => { const row = TRACKERS[0].byFrame[4].find((row) => row.id === '77');"
        "const [x, y] = scene.instance.getViewports()[0].project(Array.from(row.box.slice(0, 3)));"
        "const view = document.getElementById('view').getBoundingClientRect();"
        "return [view.left + x, view.top + y]; })()"
    )
    browser.move_mouse(place[0] - 3, place[1])
    browser.move_mouse(*place)
    tip = "document.querySelector('.deck-tooltip')?.innerText ?? ''"
    browser.wait_for(f"({tip}).includes('id 77')")
    text = browser.evaluate(tip)
    assert "class Car" in text and "score 0.700" in text
    assert "speed 18.0 m/s" in text  # 8 m/s of the car and 10 m/s of the sensor

    words = "[...document.querySelectorAll('#words b')].map((word) => word.textContent)"
    assert sorted(browser.evaluate(words)) == ["3", "77"]
    settle(browser, "scene.show(0); scene.jump(1, 0)")
    assert browser.evaluate("scene.state.frame") == 2
    assert "miss" in browser.evaluate(words)

    behind = pixels(browser)
    for camera in ("above", "world"):
        settle(browser, f"document.querySelector('[data-camera={camera}]').click()")
        assert np.abs(pixels(browser)[:600] - behind[:600]).mean() > 0.5
    settle(browser, "document.querySelector('#layers input').click()")
    assert browser.evaluate("scene.state.points") is False
    edges = "['left', 'right'].map((edge) => document.getElementById('{}')" + (
        ".getBoundingClientRect()[edge])"
    )
    panel, view = (browser.evaluate(edges.replace("{}", name)) for name in ("panel", "view"))
    assert panel[0] == 0 and panel[1] == view[0] < view[1] == 1366  # the panel covers no view
    settle(browser, "document.getElementById('fold').click()")
    assert browser.evaluate(edges.replace("{}", "view"))[0] < 50
    assert browser.evaluate("document.getElementById('settings').offsetWidth") == 0
    assert browser.errors == []
    assert [r for r in browser.requests if not r.startswith(("file:", "data:"))] == []


def test_two_trackers_are_side_by_side_or_on_each_other(browser, clip, tmp_path):
    show(browser, tmp_path / "a.html", clip, {"A": drive([3, 4]), "B": drive([8, 9], 0.2)})
    names = "[...document.querySelectorAll('#panes span')].map((name) => name.textContent)"
    assert browser.evaluate(names) == ["A", "B"]
    assert browser.evaluate("scene.instance.getViewports().length") == 2
    sums = "[...document.querySelectorAll('.sums')].map((line) => line.textContent)"
    assert browser.evaluate(sums) == [f"{n}: 0 misses, 0 false alarms, 0 switches" for n in "AB"]
    settle(
        browser, "scene.show(4); [...document.querySelectorAll('#cameras button')].at(-1).click()"
    )
    assert browser.evaluate("scene.instance.getViewports().length") == 1
    words = "[...document.querySelectorAll('#words b')].map((word) => word.textContent)"
    assert sorted(browser.evaluate(words)) == ["A3", "A4", "B8", "B9"]
    assert overlapping_words(browser) == 0  # A3 and B8 are above boxes 0.2 m apart
    assert browser.errors == []


def test_it_plays(browser, clip, tmp_path):
    show(browser, tmp_path / "a.html", clip, {"ours": drive([3])})
    browser.evaluate("document.getElementById('play').click()")
    browser.wait_for("scene.state.frame >= 2")
    browser.evaluate("document.getElementById('play').click()")
    stopped = browser.evaluate("scene.state.frame")
    assert (
        browser.evaluate("new Promise((done) => setTimeout(() => done(scene.state.frame), 400))")
        == stopped
    )
    assert browser.errors == []


@pytest.mark.parametrize("frames", [1, 1000])
def test_of_one_and_of_many_frames(browser, tmp_path, frames):
    clip = Clip("0016", range(frames), points, Objects.empty(), drive([3], frames=frames))
    show(browser, tmp_path / "a.html", clip, {"ours": drive([5], 0.1, frames)})
    assert bool(browser.evaluate("document.getElementById('slider') === null")) == (frames == 1)
    buttons = "document.querySelectorAll('#timeline button').length"
    assert browser.evaluate(buttons) == (0 if frames == 1 else 3)  # play, previous, next
    settle(browser, f"scene.show({frames - 1})")
    assert browser.evaluate("scene.state.frame") == frames - 1
    assert browser.evaluate("document.querySelector('[data-camera=world]').disabled")  # no poses
    assert browser.errors == []


def test_of_an_empty_result_without_labels(browser, tmp_path):
    clip = Clip("0016", range(FRAMES), points, Objects.empty(), Objects.empty())
    show(browser, tmp_path / "a.html", clip, {"ours": Objects.empty()})
    text = browser.evaluate("document.getElementById('timeline').innerText")
    assert "No labels: misses, false alarms and switches are unknown." in text
    assert pixels(browser)[:600].std() > 5
    assert browser.errors == []
