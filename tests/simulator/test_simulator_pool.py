"""Jobs over processes: a worker that is killed."""

import os

from common.flags import run
from simulator.pool import run_jobs


class Deadly:
    """Ends the process that unpickles it, as the kernel does when memory runs out."""

    def __reduce__(self):
        return os._exit, (9,)


def test_a_killed_worker_is_one_line_and_code_2(capsys):
    assert run(lambda argv: list(run_jobs(Deadly(), None, [(0, [0]), (1, [0])], 2)) and 0) == 2
    error = capsys.readouterr().err
    assert error == (
        "error: a worker process was killed (out of memory?); the same command goes on\n"
    )
