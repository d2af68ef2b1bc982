"""Makes the shipped weights from scratch: simulates, trains both networks, exports.

    python -m training.recipe --workdir runs/recipe --out weights --labels KITTI --scans KITTI

Every number is in training/recipe.json. Each stage is a command of this project; finished stages
are skipped and an interrupted one resumes. It runs in the project's root. Without --labels all
traffic is the simulator's own; without --scans no real scan is used.
"""

import json
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.config import parse_json
from common.errors import InputError
from common.files import copy_folder, read_bytes, write_json
from common.flags import ArgumentParser, run
from common.provenance import ROOT, git_commit
from common.steps import Steps
from kitti.sequence import open_sequences
from training.sampling.data import ALL, HELD_OUT, sequence_numbers

RECIPE = Path(__file__).with_suffix(".json")
RECORD = "recipe.json"  # of the workdir: command and commit of every stage begun


@dataclass(frozen=True)
class Stage:
    """A command of the recipe.

    Attributes:
        name: shown while it runs.
        command: arguments of the Python interpreter.
        resumes: workdir of a training; the command gets --resume where it holds one already.
    """

    name: str
    command: tuple[str, ...]
    resumes: Path | None = None

    def arguments(self) -> list[str]:
        """The command, with --resume where a training was begun."""
        begun = self.resumes is not None and (self.resumes / "config.json").is_file()
        return [*self.command, *(["--resume"] if begun else [])]


def stages_of(recipe: dict[str, Any], values: dict[str, str]) -> list[Stage]:
    """The stages of a recipe whose needs are keys of `values`, with `values` filled in."""

    def fill(text: str) -> str:
        return text.format_map(values)

    def usable(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [entry for entry in entries if entry.get("needs", "work") in values]

    roots = usable(recipe["data"])
    total = sum(root["share"] for root in roots)
    data: list[str] = []
    for i, root in enumerate(roots):
        data += ["--data_root", fill(root["root"]), "--seqs", fill(root.get("seqs", "all"))]
        if i:  # the first root takes the rest
            data += ["--share", f"{root['share'] / total:.3f}"]
    for root in usable(recipe["validation"]):
        data += ["--val_data_root", fill(root["root"])]
        data += ["--val_seqs", fill(root.get("seqs", "all"))]
    parts = {"data": shlex.join(data)}
    quoted = {name: shlex.quote(value) for name, value in values.items()}
    flags = (part["flags"].format_map(quoted) for part in usable(recipe["calibration"]))
    parts["calibration"] = " ".join(flags)
    return [
        Stage(
            stage["name"],
            tuple(shlex.split(stage["command"].format_map(quoted | parts))),
            Path(fill(stage["resumes"])) if "resumes" in stage else None,
        )
        for stage in usable(recipe["stages"])
    ]


def run_stage(stage: Stage) -> None:
    """Runs the command in the project's root, its output on this terminal.

    Raises:
        InputError: the command failed and printed its own message.
    """
    arguments = stage.arguments()
    print("$ python " + shlex.join(arguments), flush=True)
    code = subprocess.run([sys.executable, *arguments], cwd=ROOT, check=False).returncode
    if code == 130:
        raise KeyboardInterrupt
    if code:
        raise InputError(f"{stage.name}: the command ended with code {code}")


def _begun(path: Path) -> dict[str, Any]:
    """Command and commit of every stage that was begun, by name; none without the file."""
    if not path.exists():
        return {}
    begun = parse_json(read_bytes(path), path)
    stages = begun.values() if isinstance(begun, dict) else [None]
    if not all(isinstance(s, dict) and {"command", "commit"} <= set(s) for s in stages):
        raise InputError("expected command and commit of every stage", path)
    return begun


def make_weights(stages: list[Stage], work: Path, out: Path, allow_changes: bool) -> None:
    """Runs the stages that are not done and copies the weights to `out`.

    `work`/recipe.json holds the command and the commit of every stage that was begun.

    Raises:
        InputError: the tree has changes, a stage was begun with another command or at another
            commit, or a stage fails.
    """
    commit = git_commit()
    if not allow_changes and (commit is None or commit.endswith("+changes")):
        raise InputError("the tree differs from its commit: commit first, or give --allow_changes")
    path, steps = work / RECORD, Steps(work)
    begun = _begun(path)
    for stage in stages:
        if stage.name in begun and begun[stage.name]["command"] != list(stage.command):
            raise InputError(
                f"{stage.name}: was begun with another command: choose another --workdir", path
            )

    def begin(stage: Stage) -> None:
        started = begun.setdefault(stage.name, {"command": list(stage.command), "commit": commit})
        if started["commit"] != commit and not allow_changes:
            raise InputError(
                f"{stage.name}: was begun at commit {started['commit']}: check it out, or give "
                "--allow_changes",
                path,
            )
        write_json(path, begun)
        run_stage(stage)

    for number, stage in enumerate(stages, 1):
        print(f"stage {number} of {len(stages)}: {stage.name}", flush=True)
        if not steps.run(stage.name, shlex.join(stage.command), [], lambda s=stage: begin(s)):
            print("done before", flush=True)
    copy_folder(work / "weights", out)
    print(f"written to {out}")


def _check_data(values: dict[str, str]) -> None:
    """Raises InputError where sequences of --labels or --scans are missing, too few or unusable."""
    if "labels" in values:
        root, text = values["labels"], values["label_seqs"]
        labels = sequence_numbers(root, text)
        open_sequences(root, labels)
        if text == ALL:  # which the simulator does not take
            raise InputError("--label_seqs: expected numbers such as 0001-0015, found all")
        if int(HELD_OUT) not in labels or len(labels) < 2:
            expected = f"expected {HELD_OUT}, which validates, and others to train on"
            raise InputError(f"--label_seqs: {expected}, found {text}")
    if "scans" in values:
        root, text = values["scans"], values["scan_val_seqs"]
        validated = sequence_numbers(root, text)
        held_out = {(Path(root).resolve(), seq) for seq in validated}
        trained = sequence_numbers(root, values["scan_seqs"], held_out)
        open_sequences(root, [*trained, *(seq for seq in validated if seq not in trained)])
        if len(validated) < 2:
            expected = "expected two or more drives, over which the calibration is validated"
            raise InputError(f"--scan_val_seqs: {expected}, found {text}")
        both = sorted(set(trained).intersection(validated))
        if both:
            raise InputError(f"{both[0]:04d}: expected either in --scan_seqs or in --scan_val_seqs")


def main(argv: Sequence[str] | None = None) -> None:
    """Parses the flags and makes the weights."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    add = parser.add_argument
    add("--workdir", type=Path, default=Path("runs/recipe"), metavar="DIR", help="data, trainings")
    add("--out", type=Path, default=Path("weights"), metavar="DIR", help="the folder of weights")
    add("--labels", metavar="DIR", help="KITTI root whose labels drive simulated traffic")
    add("--label_seqs", default="0000-0015", metavar="SEQS", help="of --labels")
    add("--scans", metavar="DIR", help="KITTI root with real labelled scans")
    text = "of --scans, to train on"
    add("--scan_seqs", default="0001-0009,0012-0015", metavar="SEQS", help=text)
    text = "of --scans, to validate and calibrate on: two drives or more"
    add("--scan_val_seqs", default="0010,0011", metavar="SEQS", help=text)
    add("--allow_changes", action="store_true", help="although the tree differs from its commit")
    add("--list", action="store_true", help="print the commands, run none")
    flags = parser.parse_args(argv)
    values = {"work": str(flags.workdir)}
    if flags.labels:
        values |= {"labels": flags.labels, "label_seqs": flags.label_seqs}
    if flags.scans:
        values |= {
            "scans": flags.scans,
            "scan_seqs": flags.scan_seqs,
            "scan_val_seqs": flags.scan_val_seqs,
        }
    stages = stages_of(json.loads(RECIPE.read_text(encoding="utf-8")), values)
    if flags.list:
        print("\n".join("python " + shlex.join(stage.command) for stage in stages))
        return
    if Path.cwd() != ROOT:  # where the stages run: relative paths would name two folders
        raise InputError(f"expected to be run in the project's root {ROOT}", Path.cwd())
    _check_data(values)
    make_weights(stages, flags.workdir, flags.out, flags.allow_changes)


if __name__ == "__main__":
    raise SystemExit(run(main))
