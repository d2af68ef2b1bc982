"""InputError names the place of an error in one line."""

from pathlib import Path

import pytest

from common import flags
from common.errors import InputError
from common.notes import note


def test_message_names_file_and_line():
    assert str(InputError("expected 17 columns", "a/b.txt", 3)) == "a/b.txt:3: expected 17 columns"
    assert str(InputError("is empty", "a/b.txt")) == "a/b.txt: is empty"
    assert str(InputError("seqs: found 'x'")) == "seqs: found 'x'"


def test_message_is_one_line():
    assert "\n" not in str(InputError("first\n   second", "f"))


def test_is_a_value_error_and_keeps_the_place():
    error = InputError("m", "p", 7)
    assert isinstance(error, ValueError)
    assert (error.path, error.line) == ("p", 7)


def test_a_name_with_a_line_end_stays_in_one_line():
    assert str(InputError("is empty", "a\nb\t.txt", 1)) == "a\\nb\\t.txt:1: is empty"
    assert str(InputError("is empty", "ärger 1.txt")) == "ärger 1.txt: is empty"


def test_nothing_that_a_terminal_obeys_is_printed(capsys):
    """Such as in the name of a file in the message."""
    name = "a\x1b[31m\x07.bin"
    assert str(InputError(f"found {name}", name)) == r"a\x1b[31m\x07.bin: found a\x1b[31m\x07.bin"
    note(f"{name}: is not read")
    assert capsys.readouterr().err == "note: a\\x1b[31m\\x07.bin: is not read\n"
    assert flags.run(lambda argv: Path("nowhere", name).stat()) == 2
    assert "\x1b" not in capsys.readouterr().err
    with pytest.raises(SystemExit):
        flags.ArgumentParser().parse_args([name])
    assert "\x1b" not in capsys.readouterr().err
