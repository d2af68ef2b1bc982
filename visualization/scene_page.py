"""The scene as one HTML file that opens from disk: deck.gl, styles, scripts and data inside.

The package pydeck contains deck.gl for offline use.
"""

import json
import re
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader

from common.files import write_text

WEB = Path(__file__).parent / "web"
SCRIPTS = ("data.js", "dots.js", "layers.js", "network.js", "view.js", "timeline.js")
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)
"""Content security policy: a browser loads no other file."""


def write_scene(path: str | Path, title: str, scene: dict[str, Any]) -> Path:
    """Writes the page of a scene (see `visualization.scene.scene_data`), atomically."""
    write_text(path, scene_page(title, scene))
    return Path(path)


def scene_page(title: str, scene: dict[str, Any]) -> str:
    """The page as text."""
    data = {key: value for key, value in scene.items() if key != "notes"}
    return render(
        "scene.html.j2",
        title=title,
        policy=POLICY,
        style=web_file("scene.css"),
        notes=scene["notes"],
        scene=json.dumps(data, allow_nan=False, separators=(",", ":")).replace("</", "<\\/"),
        scripts=[deck_gl(), *map(web_file, SCRIPTS)],
    )


def render(template: str, **values: Any) -> str:
    """A template of `WEB` with these values, escaped."""
    environment = Environment(
        loader=FileSystemLoader(WEB), autoescape=True, trim_blocks=True, keep_trailing_newline=True
    )
    return environment.get_template(template).render(values)


@cache
def deck_gl() -> str:
    """The library's script, which defines `deck`, without reference to a source map."""
    bundle = resources.files("pydeck") / "nbextension" / "static" / "index.js"
    text = bundle.read_text(encoding="utf-8")
    text = re.sub(r"//# sourceMappingURL=\S+", "", text)
    return _parsed_once(text.replace("</script", "<\\/script").rstrip())


def _parsed_once(bundle: str) -> str:
    """The same script in a form that Chromium parses once instead of three times.

    Chromium compiles a function in brackets at once, but first parses one without to find its end.
    It parses the script again for the stack trace of an error, even of one caught at start-up.
    """
    head, tail = "})(globalThis, ", ");"
    if bundle.count(head) == 1 and bundle.endswith(tail):
        start, body = bundle.removesuffix(tail).split(head)
        bundle = f"{start}{head}({body}){tail}"
    limit = "Error.stackTraceLimit"
    return f"const traceLimit = {limit};\n{limit} = 0;\n{bundle}\n{limit} = traceLimit;"


def web_file(name: str) -> str:
    """A file of `WEB`."""
    return (WEB / name).read_text(encoding="utf-8").rstrip()
