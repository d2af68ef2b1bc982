"""Files are complete or absent."""

import errno
import json
import os
import stat
import subprocess
import sys

import pytest

from common.errors import InputError
from common.files import (
    atomic_path,
    copy_folder,
    locked,
    read_bytes,
    temporary_of,
    write_bytes,
    write_json,
    write_text,
)


def test_writes_text_bytes_and_json(tmp_path):
    write_text(tmp_path / "new" / "a.txt", "grün\n")
    write_bytes(tmp_path / "b.bin", b"\x00\xff")
    write_json(tmp_path / "c.json", {"a": [1, None]})
    assert (tmp_path / "new" / "a.txt").read_text(encoding="utf-8") == "grün\n"
    assert (tmp_path / "b.bin").read_bytes() == b"\x00\xff"
    assert json.loads((tmp_path / "c.json").read_text()) == {"a": [1, None]}
    write_text(tmp_path / "d.txt", os.fsdecode(b"name\xff"))
    assert (tmp_path / "d.txt").read_bytes() == b"name\xff"


def test_failure_leaves_the_old_file_and_no_litter(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_json_refuses_nan_before_anything_is_written(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", {"MOTA": float("nan")})
    assert os.listdir(tmp_path) == []


def test_temporary_name_keeps_suffix_and_is_hidden(tmp_path):
    with atomic_path(tmp_path / "curve.png") as temporary:
        assert temporary.suffix == ".png"
        assert temporary.name.startswith(".")
        assert temporary.parent == tmp_path


def test_mode_follows_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        write_text(tmp_path / "a.txt", "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o640


def test_directory_in_the_way_is_an_os_error(tmp_path):
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(OSError):
        write_text(tmp_path / "a.txt", "x")
    assert os.listdir(tmp_path) == ["a.txt"]


def test_only_regular_files_of_bounded_size_are_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(InputError, match="expected a regular file, found a pipe"):
            read_bytes(path)
    with (tmp_path / "sparse").open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(InputError, match="expected at most 1073741824 bytes, found 1099511627776"):
        read_bytes(tmp_path / "sparse")
    with pytest.raises(InputError, match="cannot be read"):
        read_bytes("nul\0byte")


def test_a_folder_without_new_files_names_the_file():
    with pytest.raises(OSError, match="x") as error:
        write_text("/proc/x.txt", "")
    assert error.value.filename == "/proc/x.txt"


def test_a_name_may_have_the_length_of_the_file_system(tmp_path):
    write_text(tmp_path / ("a" * 255), "b")
    assert (tmp_path / ("a" * 255)).read_text() == "b"


def test_a_full_disk_names_the_file(tmp_path):
    with pytest.raises(OSError, match="No space left") as error, atomic_path(tmp_path / "a.txt"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert error.value.filename == str(tmp_path / "a.txt")
    assert os.listdir(tmp_path) == []


HOLD = """
import sys
from common.files import locked
with locked(sys.argv[1]) as held:
    print(held, flush=True)
    sys.stdin.read()
"""


def test_a_lock_is_held_against_another_process_until_its_end(tmp_path):
    path = tmp_path / "folder" / "lock"
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", HOLD, path], stdin=pipe, stdout=pipe) as other:
        assert other.stdout.readline() == b"True\n"
        with locked(path, wait=False) as held:
            assert not held
        other.kill()
    with locked(path, wait=False) as held:
        assert held


@pytest.mark.parametrize("name", ["manifest.json", "000012.bin", "a-b.seqmap.training", "plain"])
def test_temporary_files_are_known_by_their_names(tmp_path, name):
    with atomic_path(tmp_path / name) as temporary:
        assert temporary_of(temporary) == name
    assert temporary_of(tmp_path / name) is None
    for other in (f".{name}", f".x-short{name}", f"x-abcdefgh-{name}"):
        assert temporary_of(tmp_path / other) is None


def test_a_copied_folder_has_no_unfinished_files(tmp_path):
    (tmp_path / "a").mkdir()
    for name in ("detector.npz", ".detector-abcd1234.npz", ".hidden"):
        (tmp_path / "a" / name).write_text(name)
    copy_folder(tmp_path / "a", tmp_path / "b")
    assert {path.name for path in (tmp_path / "b").iterdir()} == {"detector.npz", ".hidden"}
