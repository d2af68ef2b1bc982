"""Sequence numbers on the command line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import InputError
from kitti.seqmap import (
    SEQMAP,
    TEST,
    VAL,
    find_seqmap,
    parse_sequences,
    sequence_name,
    write_seqmap,
)


def test_splits():
    assert (VAL, len(TEST)) == ((16, 17, 18, 19, 20), 29)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0016-0020", [16, 17, 18, 19, 20]),
        ("0000,0003", [0, 3]),
        ("3, 1-2", [3, 1, 2]),
        ("0007-0007", [7]),
    ],
)
def test_reads(text, expected):
    assert parse_sequences(text) == expected


@pytest.mark.parametrize(
    "text", ["", "a", "1,,2", "3-1", "1-2-3", "-1", "1,1", "0-3,2", "00000", "1.5", "٣"]
)
def test_refuses(text):
    with pytest.raises(InputError, match="sequences"):
        parse_sequences(text)


@given(st.lists(st.integers(0, 9999), min_size=1, max_size=20, unique=True))
def test_names_are_read_back(seqs):
    assert parse_sequences(",".join(map(sequence_name, seqs))) == seqs


def test_a_sequence_that_the_seqmap_lacks_is_noted(tmp_path, capsys):
    assert find_seqmap(tmp_path, "training", 3) is None
    path = write_seqmap(tmp_path, "training", {2: 5})
    assert find_seqmap(tmp_path, "training", 2) == (path, range(5))
    assert capsys.readouterr().err == ""
    assert find_seqmap(tmp_path, "training", 3) is None
    assert "seqmap.training: sequence 0003 is not in it" in capsys.readouterr().err


@pytest.mark.parametrize(
    "ending", ["", ".txt", ".val", ".train", ".trainval", ".training_minus_val"]
)
@pytest.mark.parametrize("place", ["", "training"])
def test_seqmaps_of_splits_are_read(tmp_path, capsys, ending, place):
    (tmp_path / "training").mkdir()
    path = tmp_path / place / f"{SEQMAP}{ending}"
    path.write_text("0001 empty 000000 000447\n0006 empty 000010 000019\n")
    assert find_seqmap(tmp_path, "training", 1) == (path, range(447))
    assert find_seqmap(tmp_path, "training", 6) == (path, range(10, 20))
    assert capsys.readouterr().err == ""


def test_the_split_that_holds_a_sequence_gives_its_frames(tmp_path, capsys):
    """Of several the most general; the others are named."""
    for ending, row in ((".train", "0000 empty 0 9"), (".val", "0001 empty 3 8"), (".test", "no")):
        (tmp_path / f"{SEQMAP}{ending}").write_text(row)
    assert find_seqmap(tmp_path, "training", 0) == (tmp_path / f"{SEQMAP}.train", range(9))
    assert capsys.readouterr().err == ""
    assert find_seqmap(tmp_path, "training", 1) == (tmp_path / f"{SEQMAP}.val", range(3, 9))
    used = f"seqmap.val: the frames of its sequences are taken from it, not from {tmp_path}"
    assert f"{used}/{SEQMAP}.train\n" in capsys.readouterr().err
    path = write_seqmap(tmp_path, "training", {1: 5})
    assert find_seqmap(tmp_path, "training", 1) == (path, range(5))
    unused = f"{tmp_path}/{SEQMAP}.val, {tmp_path}/{SEQMAP}.train"
    assert (
        f"seqmap.training: the frames of its sequences are taken from it, not from {unused}\n"
        in (capsys.readouterr().err)
    )


def test_seqmaps_of_other_names_are_noted(tmp_path, capsys):
    for name in (f"{SEQMAP}.training.bak", "evaluate_mots.seqmap.val"):
        (tmp_path / name).write_text("0000 empty 000000 000004\n")
    assert find_seqmap(tmp_path, "training", 0) is None
    noted = capsys.readouterr().err.splitlines()
    assert [line.partition(": is not read; expected")[0] for line in noted] == [
        f"note: {tmp_path}/evaluate_mots.seqmap.val",
        f"note: {tmp_path}/{SEQMAP}.training.bak",
    ]
