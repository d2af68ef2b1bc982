"""Imports are followed through the project's files, and no further."""

from common import imports
from common.imports import imported_files


def test_imports_are_followed_to_any_depth(tmp_path, monkeypatch):
    monkeypatch.setattr(imports, "ROOT", tmp_path)
    for name, text in {
        "a.py": "import json\nfrom room.b import f\n",
        "room/__init__.py": "from room.c import g\n",
        "room/b.py": "def f():\n    from door import d\n",
        "room/c.py": "",
        "door/__init__.py": "import a\n",
        "door/d.py": "",
    }.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)

    def names(module):
        return [path.relative_to(tmp_path).as_posix() for path in imported_files(module)]

    assert names("a") == ["a.py", "door/__init__.py", "door/d.py", "room/b.py"]
    assert names("room") == ["room/__init__.py", "room/c.py"]
    assert names("numpy") == []


def test_the_networks_outputs_depend_on_networks_ops_and_data():
    names = {path.name for path in imported_files("evaluation.detections")}
    assert {"inference.py", "local_pointnet.py", "loading.py", "object_shift.py"} <= names
    assert not {"sort.py", "factory.py", "losses.py"} & names
