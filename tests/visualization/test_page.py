"""The HTML page is valid, loads no other file and contains its input."""

import base64

from helpers.html_check import check
from PIL import Image

from visualization.gallery import Picture
from visualization.page import page


def _page(tmp_path) -> str:
    pictures = []
    for name in ("a.png", "b.gif"):
        Image.new("RGB", (4, 3)).save(tmp_path / name)
        pictures.append(Picture(tmp_path / name, f'<{name}> & "quoted"'))
    rows = [("ours", ["PointTrackNet", "0.5"]), ("", ["SORT & <co>", "-"])]
    scenes = {"scene.html": "Turn <it>"}
    return page("A <title>", ["above", "below"], ["method", "MOTA"], rows, pictures, scenes)


def test_page_is_valid_and_stands_alone(tmp_path):
    checked = check(_page(tmp_path))
    assert checked.problems == []
    tags = [tag for tag, _ in checked.elements]
    assert tags.count("img") == 2 and tags.count("tr") == 3 and tags.count("title") == 1
    assert ("meta", {"charset": "utf-8"}) in checked.elements


def test_page_is_readable_on_a_phone(tmp_path):
    text = _page(tmp_path)
    assert 'name="viewport" content="width=device-width' in text
    assert "img { max-width: 100%" in text
    assert '<div class="wide"><table>' in text and ".wide { overflow-x: auto; }" in text


def test_pictures_are_inside_and_text_is_escaped(tmp_path):
    text = _page(tmp_path)
    data = base64.b64encode((tmp_path / "b.gif").read_bytes()).decode()
    assert f"data:image/gif;base64,{data}" in text
    assert "SORT &amp; &lt;co&gt;" in text and "<co>" not in text
    assert '<a href="scene.html">Turn &lt;it&gt;</a>' in text


def test_the_checker_finds_faults():
    bad = "<!DOCTYPE html><html><body><p><img src='http://x/a.png'></body></html>"
    problems = check(bad).problems
    assert any("refers to http" in p for p in problems)
    assert "img without alt" in problems
    assert any("closes nothing" in p for p in problems)
