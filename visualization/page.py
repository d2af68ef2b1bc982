"""One HTML page with a table, embedded pictures, and links to scenes."""

import base64
from collections.abc import Mapping, Sequence

from visualization.gallery import Picture
from visualization.scene_page import render, web_file

MEDIA = {".png": "image/png", ".gif": "image/gif"}


def page(
    title: str,
    notes: Sequence[str],
    header: Sequence[str],
    rows: Sequence[tuple[str, Sequence[str]]],
    pictures: Sequence[Picture],
    scenes: Mapping[str, str],
) -> str:
    """The page as text.

    Args:
        title: of the page; notes: paragraphs above and below the table (the first goes above).
        header, rows: the table; a row is (class, cells), the class "ours", "paper" or "".
        pictures: PNG and GIF files, which are embedded.
        scenes: name of a file in the folder of the page -> its caption.
    """
    return render(
        "page.html.j2",
        title=title,
        style=web_file("page.css"),
        notes=notes,
        header=header,
        rows=rows,
        scenes=scenes.items(),
        pictures=[{"caption": picture.caption, "data": _data(picture)} for picture in pictures],
    )


def _data(picture: Picture) -> str:
    data = base64.b64encode(picture.path.read_bytes()).decode("ascii")
    return f"data:{MEDIA[picture.path.suffix]};base64,{data}"
