"""Data flags: sequences, shares, held-out sequences."""

import argparse

import pytest
from helpers.two_cars import write_sequence

from common.errors import InputError
from kitti.sequence import KittiSequence
from training.sampling.data import (
    HELD_OUT,
    TRAINED,
    Pool,
    add_data_flags,
    check_objects,
    labelled_sequences,
    open_data,
)
from training.sampling.frame_reader import FrameReader
from training.sampling.frames import frame_list, pair_list

CLASSES = ("Car", "Van")


@pytest.fixture(scope="module")
def roots(tmp_path_factory):
    """a with sequences 0000, 0001 and 0011, b with 0003 and 0007 (and a gap)."""
    a, b = (tmp_path_factory.mktemp(name) for name in "ab")
    for seq in (0, 1, 11):
        write_sequence(a, seq, frames=3)
    write_sequence(b, 3, frames=2)
    write_sequence(b, 7, frames=6, missing=(2, 3))
    return str(a), str(b)


def opened(*words: str):
    parser = argparse.ArgumentParser()
    add_data_flags(parser)
    return open_data(parser.parse_args(words))


def names(sequences: list[KittiSequence]) -> list[str]:
    return [sequence.name for sequence in sequences]


def test_all_means_labelled_and_not_held_out(roots):
    a, b = roots
    data = opened("--data_root", a, "--data_root", b, "--seqs", "all")
    assert names(data.training) == ["0000", "0001", "0003", "0007"]
    assert names(data.validation) == [HELD_OUT] == ["0011"]
    assert data.pools == [Pool(1.0, (0, 1, 2, 3))]
    assert labelled_sequences(a) == [0, 1, 11]
    with pytest.raises(InputError, match="expected label files"):
        labelled_sequences(a + "/training")


def test_a_root_without_scans_is_named(roots, tmp_path):
    a, _ = roots
    write_sequence(tmp_path, 2, frames=2, missing=(0, 1))
    words = ("--data_root", a, "--seqs", "0000", "--data_root", str(tmp_path), "--seqs", "0002")
    with pytest.raises(InputError, match=rf"{tmp_path}: expected scans of 0002 in training/velo"):
        opened(*words, "--val_data_root", a, "--val_seqs", "0011")


def test_data_without_an_object_to_train_on_is_refused(roots, capsys):
    a, b = roots
    data = opened("--data_root", b, "--seqs", "all", "--val_data_root", a)
    check_objects(data, CLASSES)
    assert capsys.readouterr().err == ""
    with pytest.raises(
        InputError, match=r"label_02: there is no labelled box of Tram in the train"
    ):
        check_objects(data, ("Tram",))
    path = data.validation[0].label_path
    for sequence in data.validation:
        sequence.objects = sequence.objects[:0]
    check_objects(data, CLASSES)
    noted = f"{path.parent}: there is no labelled box of Car, Van in the validation sequences"
    assert noted in capsys.readouterr().err


def test_default_trains_on_all_of_the_papers_but_the_one_held_out():
    first, last = (part.split("-") for part in TRAINED.split(","))
    assert (first, last) == (["0000", "0010"], ["0012", "0015"])


def test_validation_roots_give_all_of_theirs_unless_named(roots):
    a, b = roots
    train = ("--data_root", a, "--seqs", "0000-0001")
    assert names(opened(*train, "--val_data_root", b).validation) == ["0003", "0007"]
    named = opened(*train, "--val_data_root", a, "--val_seqs", "0011", "--val_data_root", b,
                   "--val_seqs", "0007")  # fmt: skip
    assert names(named.validation) == ["0011", "0007"]


def test_training_on_validation_sequences_is_refused(roots):
    a, b = roots
    words = ("--data_root", b, "--seqs", "0003", "--data_root", a + "/../" + a.split("/")[-1])
    with pytest.raises(InputError, match="sequence 0001: expected either in --seqs or"):
        opened(*words, "--seqs", "0000-0001", "--val_data_root", a, "--val_seqs", "0001")
    same_number = opened("--data_root", a, "--seqs", "0000", "--val_data_root", b)
    assert names(same_number.training) == ["0000"]


def test_a_share_applies_to_the_root_before_it(roots):
    a, b = roots
    seqs = ("--seqs", "0000-0001", "--seqs", "all")
    data = opened("--data_root", a, "--data_root", b, "--share", "0.3", *seqs)
    assert data.pools == [Pool(0.7, (0, 1)), Pool(0.3, (2, 3))]
    assert [part["share"] for part in data.record()["shares"]] == [0.7, 0.3]
    assert data.record()["shares"][1]["sequences"] == [f"{b}/0003", f"{b}/0007"]
    data = opened("--data_root", a, "--share", "0.25", "--data_root", b, "--share", "0.75", *seqs)
    assert data.pools == [Pool(0.25, (0, 1)), Pool(0.75, (2, 3))]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--data_root A --share 0.7 --data_root B --share 0.4"), "at most 1 together, found 1.1"),
        (("--data_root A --share 0.5"), "expected 1 together where each root has one, found 0.5"),
        (("--data_root A --share 1 --data_root B"), "leave nothing for the roots without one"),
        (("--data_root A --seqs all --seqs all"), "--seqs: expected one, or one for each"),
        (("--data_root A --val_seqs all --val_seqs 0001"), "--val_seqs: expected one, or one for"),
    ],
)
def test_shares_and_counts_that_do_not_fit(roots, words, message):
    words = [dict(zip("AB", roots, strict=True)).get(word, word) for word in words.split()]
    seqs = [] if "--seqs" in words else ["--seqs", "all"]
    with pytest.raises(InputError, match=message):
        opened(*words, *seqs)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--share", "0.3", "--data_root", "x"), "expected once after the --data_root"),
        (("--data_root", "x", "--share", "0.3", "--share", "0.2"), "expected once after"),
        (("--data_root", "x", "--share", "0"), "expected 0.001 to 1, found '0'"),
        (("--data_root", "x", "--share", "half"), "expected 0.001 to 1, found 'half'"),
    ],
)
def test_misplaced_shares(words, message, capsys):
    with pytest.raises(SystemExit):
        opened(*words)
    assert message in capsys.readouterr().err


def test_gaps_make_no_pairs(roots):
    data = opened("--data_root", roots[1], "--seqs", "0007", "--val_data_root", roots[0])
    assert frame_list(data.training) == [(0, 0), (0, 1), (0, 4), (0, 5)]
    assert pair_list(data.training) == [(0, 1), (0, 5)]
    frame = FrameReader(data.training, CLASSES).read(0, 4)
    assert len(frame.boxes) == 2 and len(frame.points) > 100


def test_all_that_leaves_nothing_to_train(roots):
    words = ("--data_root", roots[1], "--seqs", "all", "--val_data_root", roots[1])
    with pytest.raises(InputError, match="every labelled sequence is validated on: none is left"):
        opened(*words)
