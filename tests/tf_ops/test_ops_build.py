"""The build of the ops: its errors, what it makes again, and what it leaves when it fails."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import tensorflow as tf

import tf_ops

ROOT = Path(tf_ops.__file__).resolve().parent.parent
OF_MAKE = ("MAKEFLAGS", "MFLAGS", "MAKELEVEL", "MAKEOVERRIDES")  # of a `make` that runs the tests


def make(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    """Runs `make` in a folder as from a shell."""
    environment = {name: value for name, value in os.environ.items() if name not in OF_MAKE}
    return subprocess.run(
        ["make", "--no-print-directory", "-C", str(folder), *arguments],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def build(tmp_path: Path, *arguments: str) -> str:
    """The one line of a failing `make` in a copy of the build's files."""
    folder = tmp_path / "tf_ops"
    folder.mkdir(exist_ok=True)
    for name in ("Makefile", "tf_flags.py"):
        (folder / name).write_bytes((ROOT / "tf_ops" / name).read_bytes())
    result = make(folder, *arguments)
    assert result.returncode != 0
    lines = (result.stdout + result.stderr).strip().splitlines()
    assert len(lines) == 1
    return lines[0]


def test_build_without_a_compiler_gives_one_line(tmp_path):
    line = build(tmp_path, f"PYTHON={sys.executable}", "CXX=no-such-compiler")
    assert '"no-such-compiler" was not found' in line
    assert "make ops CXX=clang++" in line


def test_build_without_python_gives_one_line_even_after_another_build(tmp_path):
    flags = tmp_path / "tf_ops" / "build" / "flags.mk"
    flags.parent.mkdir(parents=True)
    flags.write_text("TF_CFLAGS := -I/somewhere\n")
    line = build(tmp_path, "PYTHON=/no/such python")
    assert 'no Python: "/no/such python" was not found' in line and "make PYTHON=" in line


@pytest.mark.parametrize(
    "raised", ["TypeError('Descriptors cannot be created')", "ImportError('x')"]
)
def test_build_with_a_broken_tensorflow_gives_one_line(tmp_path, monkeypatch, raised):
    (tmp_path / "tensorflow").mkdir()
    (tmp_path / "tensorflow" / "__init__.py").write_text(f"raise {raised}\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    line = build(tmp_path, f"PYTHON={sys.executable}")
    assert f"TensorFlow cannot be used ({raised.split(chr(39))[1]}): run `make venv`" in line


def _tf_flags():
    spec = importlib.util.spec_from_file_location("tf_flags", ROOT / "tf_ops" / "tf_flags.py")
    tf_flags = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tf_flags)
    return tf_flags


def test_flags_of_a_tensorflow_in_a_folder_with_a_space(tmp_path, monkeypatch):
    tf_flags = _tf_flags()
    monkeypatch.setattr(
        tf.sysconfig, "get_compile_flags", lambda: ["-I/my folder/include", "-DA=1"]
    )
    monkeypatch.setattr(tf.sysconfig, "get_link_flags", lambda: ["-L/my folder", "-l:lib.so.2"])
    lines = tf_flags.fragment("here").splitlines()
    assert lines[0] == "TF_CFLAGS := -isystem '/my folder/include' -DA=1"
    assert lines[1] == "TF_LFLAGS := '-L/my folder' -l:lib.so.2"


def test_build_without_tensorflow_gives_one_line(tmp_path):
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" -S -E "$@"\n')
    python.chmod(0o755)
    line = build(tmp_path, f"PYTHON={python}")
    assert "TensorFlow is not installed" in line and "run `make venv`" in line


def test_a_truncated_file_of_flags_is_made_again(tmp_path, monkeypatch):
    tf_flags = _tf_flags()
    path = tmp_path / "build" / "flags.mk"
    assert tf_flags.main(path) is None
    whole = path.read_text()
    for size in range(0, len(whole) - 1, 40):
        path.write_text(whole[:size])
        assert tf_flags.main(path) is None
        assert path.read_text() == whole
    assert list(path.parent.iterdir()) == [path]
    monkeypatch.setattr(tf_flags, "fragment", None)
    assert tf_flags.main(path) is None  # a whole one is kept


def _source(name: str) -> str:
    return f'extern "C" __attribute__((visibility("default"))) int {name}() {{ return 1; }}\n'


@pytest.fixture(name="small")
def small_fixture(tmp_path):
    """The build's files with two small sources, and `run`, which builds them without TensorFlow.

    `run` uses a compiler that fails with a half-written output while the file `broken` exists.
    """
    folder = tmp_path / "tf_ops"
    (folder / "core").mkdir(parents=True)
    (folder / "build").mkdir()
    shutil.copy(ROOT / "tf_ops" / "Makefile", folder)
    (folder / "build" / "flags.mk").write_text("TF_CFLAGS :=\nTF_LFLAGS :=\nTF_RECORD := first\n")
    for name in ("one", "two"):
        (folder / "core" / f"{name}.cc").write_text(_source(f"number_{name}"))
    compiler = folder / "compiler"
    compiler.write_text(
        f'#!/bin/sh\ntest -e "{folder}/broken" || exec c++ "$@"\n'
        'while test "$1" != -o; do shift; done; echo half > "$2"; exit 1\n'
    )
    compiler.chmod(0o755)
    return folder


def run(folder: Path, *arguments: str) -> bool:
    return make(folder, "PYTHON=true", f"CXX={folder / 'compiler'}", *arguments).returncode == 0


def test_the_library_follows_its_sources_and_flags(small):
    library = small / "build" / "libtf_ops.so"
    assert run(small)
    assert b"number_one" in library.read_bytes() and b"number_two" in library.read_bytes()
    assert (small / "build" / "libtf_ops.json").read_text() == "first\n"
    kept = library.stat().st_mtime_ns, (small / "build/portable/core/one.o").stat().st_mtime_ns
    (small / "core" / "two.cc").unlink()
    assert run(small)
    assert b"number_one" in library.read_bytes() and b"number_two" not in library.read_bytes()
    assert run(small, "LDFLAGS=-Wl,-soname,renamed.so")
    assert b"renamed.so" in library.read_bytes()
    now = library.stat().st_mtime_ns, (small / "build/portable/core/one.o").stat().st_mtime_ns
    assert now[0] > kept[0] and now[1] == kept[1]  # linked again, not compiled


def test_nothing_half_written_is_taken_for_finished(small):
    broken, library = small / "broken", small / "build" / "libtf_ops.so"
    broken.touch()
    assert not run(small)
    assert not list(small.glob("build/**/*.o"))
    broken.unlink()
    assert run(small)
    whole = library.read_bytes()
    broken.touch()
    assert not run(small, "LDFLAGS=-Wl,-soname,renamed.so")
    assert library.read_bytes() == whole
    assert (small / "build/portable/libtf_ops.so").read_bytes() == whole
    broken.unlink()
    assert run(small, "LDFLAGS=-Wl,-soname,renamed.so")
    assert b"renamed.so" in library.read_bytes()
    left = {path.suffix for path in small.glob("build/**/*") if path.is_file()}
    assert left <= {"", ".mk", ".o", ".d", ".so", ".json"}


def test_the_record_is_never_newer_than_the_library(small):
    """A library that cannot be replaced keeps its record of TensorFlow."""
    assert run(small)
    flags = small / "build" / "flags.mk"
    flags.write_text(flags.read_text().replace("first", "second"))
    (small / "core" / "two.cc").unlink()
    (small / "build" / "libtf_ops.so.new").mkdir()
    assert not run(small)
    assert (small / "build" / "libtf_ops.json").read_text() == "first\n"
    shutil.rmtree(small / "build" / "libtf_ops.so.new")
    assert run(small)
    assert (small / "build" / "libtf_ops.json").read_text() == "second\n"


def test_sanitized_tests_in_a_folder_with_a_space(small, tmp_path):
    folder = tmp_path / "my folder"
    small.rename(folder)
    found = make(folder, "PYTHON=true", "-n", "sanitized-tests").stdout
    assert f'TF_OPS_LIBRARY="{folder}/build/address,undefined/libtf_ops.so"' in found


def test_clean_ops_deletes_the_build_alone():
    lines = make(ROOT, "-n", "clean-ops").stdout.splitlines()
    assert [line for line in lines if "rm" in line.split()] == ["rm -rf build"]
