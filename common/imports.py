"""Finds the project's files that a module imports, without running them."""

import ast
from pathlib import Path

from common.provenance import ROOT


def imported_files(*modules: str) -> list[Path]:
    """Files of the modules and of the project's modules they import, at any depth, sorted.

    Imports within functions count. `from package.module import name` counts `module` alone, not the
    other imports of `package/__init__.py`.
    """
    found: set[Path] = set()
    waiting = list(modules)
    while waiting:
        path = _file_of(waiting.pop())
        if path is None or path in found:
            continue
        found.add(path)
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Import):
                waiting += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                waiting += [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
    return sorted(found)


def _file_of(module: str) -> Path | None:
    """The file of a module of this project; None for any other."""
    base = ROOT.joinpath(*module.split("."))
    files = (base.with_name(f"{base.name}.py"), base / "__init__.py")
    return next((path for path in files if path.is_file()), None)
