"""Provenance of a result: command, config, seed, data, software versions and git commit."""

import os
import platform
import shlex
import subprocess
import sys
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = (
    "numpy",
    "scipy",
    "shapely",
    "filterpy",
    "motmetrics",
    "trackeval",
    "tensorflow",
    "keras",
)


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def git_commit() -> str | None:
    """The checkout's commit, with "+changes" if the tree differs from it; None without git.

    None too for a copy without its own repository inside that of another project.
    """

    def git(*args: str) -> str:
        return subprocess.run(
            ["git", "-C", str(ROOT), *args], check=True, timeout=20, capture_output=True, text=True
        ).stdout.strip()

    try:
        if git("rev-parse", "--show-cdup"):  # the way up to the repository's root
            return None
        return git("rev-parse", "HEAD") + (
            "+changes" if git("status", "--porcelain", "-uno") else ""
        )
    except (OSError, subprocess.SubprocessError):
        return None


def command() -> str:
    """The command line of this process: `evaluate.py ...` or `python -m experiments.table2 ...`."""
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    if spec is None:
        program = [Path(sys.argv[0]).name]
    else:
        program = ["python", "-m", spec.name.removesuffix(".__main__")]
    return shlex.join([*program, *sys.argv[1:]])


def provenance(**details: Any) -> dict[str, Any]:
    """A JSON-ready record of this run; `details` (config, seed, data set...) are added to it."""
    return {
        "command": command(),
        "time_utc": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "git_commit": git_commit(),
        "machine": {
            "cpu_count": _cpu_count(),
            "processor": processor(),
            "system": platform.system(),
            "architecture": platform.machine(),
        },
        "versions": _versions(),
        **details,
    }


def processor(cpu_info: Path = Path("/proc/cpuinfo")) -> str:
    """The processor's model, or that of `platform` where Linux's list is missing."""
    try:
        lines = cpu_info.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor()


def _cpu_count() -> int:
    found = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return found or 1
