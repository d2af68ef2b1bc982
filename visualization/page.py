"""One HTML page with table, pictures and provenance; nothing outside the file is needed."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from html import escape
from typing import Any

from visualization.gallery import Picture

MEDIA = {".png": "image/png", ".gif": "image/gif"}
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 0 auto; padding: 1rem;
  color: #1b1b1b; background: #ffffff; }
h1 { font-size: 1.6rem; line-height: 1.2; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.9rem; }
th, td { padding: 0.25rem 0.6rem; text-align: right; white-space: nowrap; }
th:first-child, td:first-child, td:nth-child(2), th:nth-child(2),
td:nth-child(3), th:nth-child(3) { text-align: left; }
thead th { border-bottom: 2px solid #444; }
tbody tr.paper { color: #666; border-bottom: 1px solid #ccc; }
tbody tr.ours { font-weight: 600; }
figure { margin: 2rem 0; }
img { max-width: 100%; height: auto; border: 1px solid #ddd; }
figcaption, .note { color: #444; font-size: 0.9rem; }
pre { overflow-x: auto; background: #f4f4f4; padding: 0.8rem; font-size: 0.8rem; }
"""


def page(
    title: str,
    notes: Sequence[str],
    header: Sequence[str],
    rows: Sequence[tuple[str, Sequence[str]]],
    pictures: Sequence[Picture],
    record: Any,
) -> str:
    """The page as text.

    Args:
        title: of the page; notes: paragraphs above and below the table (the first goes above).
        header, rows: the table; a row is (class, cells), the class "ours", "paper" or "".
        pictures: PNG and GIF files, which are put into the page.
        record: provenance, JSON-ready.
    """
    above, below = notes[:1], notes[1:]
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title>",
            f"<style>{STYLE}</style>",
            "</head>",
            "<body>",
            f"<h1>{escape(title)}</h1>",
            *(f"<p>{escape(note)}</p>" for note in above),
            _table(header, rows),
            *(f'<p class="note">{escape(note)}</p>' for note in below),
            *(_figure(picture) for picture in pictures),
            "<h2>What made this page</h2>",
            f"<pre>{escape(json.dumps(record, indent=2))}</pre>",
            "</body>",
            "</html>",
            "",
        ]
    )


def _table(header: Sequence[str], rows: Sequence[tuple[str, Sequence[str]]]) -> str:
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in header)
    body = [
        (f'<tr class="{kind}">' if kind else "<tr>")
        + "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        + "</tr>"
        for kind, cells in rows
    ]
    return "\n".join(
        [
            '<div class="wide"><table>',
            f"<thead><tr>{head}</tr></thead>",
            "<tbody>",
            *body,
            "</tbody></table></div>",
        ]
    )


def _figure(picture: Picture) -> str:
    data = base64.b64encode(picture.path.read_bytes()).decode("ascii")
    kind = MEDIA[picture.path.suffix]
    text = escape(picture.caption, quote=True)
    return (
        f'<figure><img alt="{text}" src="data:{kind};base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )
