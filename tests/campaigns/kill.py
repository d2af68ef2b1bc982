"""SIGKILL at random moments of every long job; the resumed job must give the same bits.

    python -m campaigns.kill --n 12 --seed 0      (from the root, PYTHONPATH=.:tests)

A job runs undisturbed once. Then it is killed one to three times in a row and run to its end; its
output has to equal that of the undisturbed run.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from campaigns.kill_jobs import JOBS, ROOT, Digest, Job, make_inputs

ENVIRONMENT = {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}", "TF_CPP_MIN_LOG_LEVEL": "3"}


def run(job: Job, inputs: Path, out: Path, kill_after: float | None = None) -> float:
    """Runs the job, to its end or until it is killed; returns the seconds it took.

    Raises:
        RuntimeError: it ended by itself with another code than 0.
    """
    start = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, *job.command(inputs, out)],
        cwd=ROOT,
        env={**os.environ, **ENVIRONMENT},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=kill_after)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return time.monotonic() - start
    if process.returncode:
        raise RuntimeError(f"exit code {process.returncode}: {output.decode()[-2000:]}")
    return time.monotonic() - start


def trial(
    job: Job, inputs: Path, expected: Digest, seconds: float, rng: np.random.Generator
) -> tuple[int, str | None]:
    """Kills a job and completes it; returns the number of kills, and the difference if any."""
    kills = int(rng.integers(1, 4))
    moments = rng.uniform(0.0, seconds, kills).round(2).tolist()
    with tempfile.TemporaryDirectory(prefix="kill-") as folder:
        out = Path(folder) / "out"
        try:
            for moment in moments:
                run(job, inputs, out, moment)
            run(job, inputs, out)
        except RuntimeError as error:
            return kills, f"killed after {moments} s: {error}"
        found = job.digest(out)
    names = sorted(n for n in expected.keys() | found.keys() if expected.get(n) != found.get(n))
    return kills, f"killed after {moments} s: {', '.join(names[:5])} differ" if names else None


def campaign(n: int, seed: int, names: list[str]) -> tuple[int, list[str]]:
    """At least `n` kills of jobs drawn at random; returns how many, and the finds as texts."""
    rng = np.random.default_rng(seed)
    done, finds = 0, []
    with tempfile.TemporaryDirectory(prefix="kill-") as folder:
        inputs = Path(folder) / "inputs"
        make_inputs(inputs)
        whole = {}
        for name in names:
            out = Path(folder) / name
            seconds = run(JOBS[name], inputs, out)
            whole[name] = JOBS[name].digest(out), seconds
        while done < n:
            name = names[int(rng.integers(len(names)))]
            kills, found = trial(JOBS[name], inputs, *whole[name], rng)
            done += kills
            print(f"{name}: {kills} kills, {found or 'equal'}", flush=True)
            if found is not None:
                finds.append(f"{name}: {found}")
    return done, finds


def main() -> int:
    """Prints a line per trial and a summary; returns 1 if anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, default=12, help="kills in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--job", choices=JOBS, action="append", help="default: all")
    args = parser.parse_args()
    start = time.monotonic()
    done, finds = campaign(args.n, args.seed, args.job or list(JOBS))
    print(f"{done} kills, {len(finds)} finds, {time.monotonic() - start:.0f} s")
    return 1 if finds else 0


if __name__ == "__main__":
    raise SystemExit(main())
