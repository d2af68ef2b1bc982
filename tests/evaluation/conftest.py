"""evaluate.py called as from the command line."""

import pytest
from helpers import tiny_kitti

import evaluate
from common import flags


@pytest.fixture
def fails(capsys):
    """Returns call(*argv): asserts exit code 2 and one line on stderr, gives that line."""

    def call(*argv) -> str:
        capsys.readouterr()
        try:
            code = flags.run(evaluate.main, [str(value) for value in argv])
        except SystemExit as end:  # argparse
            code = end.code
        error = capsys.readouterr().err
        assert code == 2, error
        assert error.count("\n") == 1 and "Traceback" not in error, error
        return error

    return call


@pytest.fixture
def root(tmp_path):
    """A data set that a test may change."""
    return tiny_kitti.make(tmp_path / "kitti")
