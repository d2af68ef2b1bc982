"""Sequence numbers on the command line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import InputError
from kitti.seqmap import (
    TEST,
    VAL,
    frames_in_seqmap,
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
    assert frames_in_seqmap(tmp_path, "training", 3) is None
    write_seqmap(tmp_path, "training", {2: 5})
    assert frames_in_seqmap(tmp_path, "training", 2) == range(5)
    assert capsys.readouterr().err == ""
    assert frames_in_seqmap(tmp_path, "training", 3) is None
    assert "seqmap.training: sequence 0003 is not in it" in capsys.readouterr().err
