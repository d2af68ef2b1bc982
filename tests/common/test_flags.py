"""Command lines: one line of error, exit code 2."""

import argparse
import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from common import flags
from common.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


def _raiser(error):
    def main(argv):
        raise error

    return main


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (InputError("expected 17 columns", "f.txt", 3), "error: f.txt:3: expected 17 columns"),
        (OSError(errno.ENOSPC, "No space left", "o.txt"), "error: o.txt: No space left"),
        (OSError("odd"), "error: odd"),
        (
            ImportError("lib.so is missing;\nrun `make ops`"),
            "error: lib.so is missing; run `make ops`",
        ),
        (
            ModuleNotFoundError("No module named 'keras'"),
            "error: No module named 'keras': run `make` in the project's root, and use "
            ".venv/bin/python",
        ),
    ],
)
def test_bad_input_is_one_line_and_code_2(capsys, error, line):
    assert flags.run(_raiser(error)) == 2
    assert capsys.readouterr().err == line + "\n"


def test_interrupt_is_130(capsys):
    assert flags.run(_raiser(KeyboardInterrupt())) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_other_errors_are_not_hidden():
    with pytest.raises(ZeroDivisionError):
        flags.run(_raiser(ZeroDivisionError()))


def test_success_gives_mains_code():
    assert flags.run(lambda argv: None) == 0
    assert flags.run(lambda argv: 5) == 5


@pytest.mark.parametrize(
    "argv", [["--unknown", "1"], ["--numb", "3"], ["--number", "x"], ["a\nb"], ["--number", "a\nb"]]
)
def test_unknown_abbreviated_or_wrong_flag(capsys, argv):
    parser = flags.ArgumentParser(prog="tool")
    parser.add_argument("--number", type=flags.positive_int, default=1)
    with pytest.raises(SystemExit) as stop:
        parser.parse_args(argv)
    assert stop.value.code == 2
    err = capsys.readouterr().err
    assert err.startswith("tool: error: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize("value", ["-1e-3", "-2E5", "-.5", "-7", "-y,x,z"])
def test_a_value_may_begin_with_a_dash(value):
    parser = flags.ArgumentParser()
    parser.add_argument("--value")
    figures = parser.add_subparsers()
    figures.add_parser("part").add_argument("--other")
    assert parser.parse_args(["--value", value]).value == value
    assert parser.parse_args(["part", "--other", value]).other == value


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("--epochs", ", is it --schedule.epochs?"),
        ("--data-root=x", ", is it --data_root?"),
        ("--rate", ""),  # of two
        ("--poch", ""),
    ],
)
def test_the_flag_that_is_meant_is_named(capsys, word, meant):
    parser = flags.ArgumentParser(prog="tool")
    for name in ("--data_root", "--schedule.epochs", "--a.rate", "--b.rate"):
        parser.add_argument(name)
    with pytest.raises(SystemExit):
        parser.parse_args([word, "5"])
    assert f"unrecognized arguments: {word} 5{meant} (see --help)\n" in capsys.readouterr().err


def test_help_names_defaults_that_there_are(capsys):
    parser = flags.ArgumentParser(prog="tool")
    parser.add_argument("--needed", required=True, help="N.")
    parser.add_argument("--some", nargs="+", default=[], help="S.")
    parser.add_argument("--switch", action="store_true", help="W.")
    parser.add_argument("--own", type=int, help="O (default: 200)")
    parser.add_argument("--seed", type=int, default=7, help="of chance")
    with pytest.raises(SystemExit):
        parser.parse_args(["--help"])
    text = capsys.readouterr().out
    assert text.count("default") == 2
    assert "O (default: 200)\n" in text and "of chance (default: 7)\n" in text


def test_a_word_behind_a_dash_is_no_flag(capsys):
    with pytest.raises(SystemExit):
        flags.ArgumentParser(prog="tool").parse_args(["-seqs"])
    assert capsys.readouterr().err == "tool: error: unrecognized arguments: -seqs (see --help)\n"


@pytest.mark.parametrize(
    ("kind", "good", "value"),
    [
        (flags.positive_int, "12", 12),
        (flags.positive_int, "+3", 3),
        (flags.non_negative_int, "0", 0),
        (flags.finite_float, "-1.5e2", -150.0),
        (flags.non_negative_float, "0", 0.0),
    ],
)
def test_types_read_good_values(kind, good, value):
    assert kind(good) == value


@pytest.mark.parametrize(
    ("kind", "bad"),
    [
        (flags.positive_int, "0"),
        (flags.positive_int, "-3"),
        (flags.positive_int, "1.5"),
        (flags.positive_int, "+-2"),
        (flags.non_negative_int, "-1"),
        (flags.non_negative_int, ""),
        (flags.non_negative_int, "\u0663"),
        (flags.positive_int, "\u00b2"),
        (flags.positive_int, "9" * 5000),
        (flags.positive_int, "1000001"),
        (flags.finite_float, "nan"),
        (flags.finite_float, "inf"),
        (flags.finite_float, "two"),
        (flags.non_negative_float, "-0.1"),
    ],
)
def test_types_refuse_bad_values(kind, bad):
    with pytest.raises((argparse.ArgumentTypeError, ValueError)):
        kind(bad)


REFUSING = "import sys; from common import flags; from common.errors import InputError\n"


@pytest.mark.parametrize(
    ("redirection", "code"),
    [
        ("2>&-", "def main(argv): raise InputError('bad')"),
        ("2>/dev/full", "def main(argv): raise InputError('bad')"),
        ("2>&- >&-", "def main(argv): print('x'); raise InputError('bad')"),
        (">/dev/full", "def main(argv): print('x' * 10_000)"),
        (">/dev/full", "def main(argv): print('x')"),
    ],
)
def test_a_stream_that_takes_nothing_changes_no_exit_code(redirection, code):
    done = _run(code, redirection)
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr
    assert done.stderr.count(b"\n") <= 1
    if redirection == ">/dev/full":
        assert done.stderr.startswith(b"error: standard output: ")


def _run(code, redirection):
    """Runs a main program that is this code under a redirection of the shell."""
    program = f"{REFUSING}{code}\nsys.exit(flags.run(main))"
    return subprocess.run(
        ["sh", "-c", f'"{sys.executable}" -c "$PROGRAM" {redirection}'],
        check=False,
        capture_output=True,
        env={**os.environ, "PROGRAM": program},
        cwd=ROOT,
    )


def test_names_of_files_that_are_no_text_can_be_printed():
    done = _run(r"def main(argv): print('o\udcff'); raise InputError('bad', 'o\udcff')", "")
    assert (done.returncode, done.stdout) == (2, b"o\\udcff\n")
    assert done.stderr == b"error: o\\udcff: bad\n"


@pytest.mark.parametrize("redirection", ["2>/dev/full", "2>&-"])
def test_progress_and_notes_that_nobody_can_read_lose_no_work(redirection):
    code = (
        "from common.notes import note\nfrom common.progress import progress\n"
        "def main(argv): note('x'); print(list(progress('ab', 2, 'x')))"
    )
    done = _run(code, redirection)
    assert (done.returncode, done.stdout) == (0, b"['a', 'b']\n")


@pytest.mark.parametrize("words", [["--out", ""], ["--out="], ["--out", " "], ["--out", "a", ""]])
def test_empty_values_are_refused(capsys, words):
    """Those of unset variables of a shell."""
    parser = flags.ArgumentParser(prog="tool")
    parser.add_argument("--out", type=Path, nargs="+")
    with pytest.raises(SystemExit) as stop:
        parser.parse_args(words)
    assert stop.value.code == 2
    assert "expected a value, found '" in capsys.readouterr().err
    assert parser.parse_args(["--out", "a=", "b"]).out == [Path("a="), Path("b")]


@pytest.mark.parametrize("text", ["\u0663", "1_0", "x", "", "1" * 5000])
def test_numbers_are_ascii_digits(text):
    for parse in (flags.integer, flags.positive_int, flags.non_negative_int):
        with pytest.raises(argparse.ArgumentTypeError, match="expected an integer"):
            parse(text)
    with pytest.raises(argparse.ArgumentTypeError, match="expected a finite number"):
        flags.finite_float(text)
    if len(text) < 9:
        with pytest.raises(argparse.ArgumentTypeError, match="expected a number"):
            flags.number(text)
    assert (flags.integer("-7"), flags.number("1e-3")) == (-7, 0.001)
