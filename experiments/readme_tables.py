"""Fills the tables of docs/tables into the documents: no measured number there is typed by hand.

    python -m experiments.readme_tables          write them
    python -m experiments.readme_tables --check  fail if a document differs from the files

A table is placed between `<!-- table: NAME -->` and `<!-- end -->`. It is the text of
docs/tables/NAME.md without its title, and one line about the run that made it (date, commit,
machine, versions, command) from docs/tables/NAME.json, or a line that says that NAME.md is missing.
The table `summary` is made of validation.json and real.json.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from common.errors import InputError
from common.files import write_text
from common.flags import ArgumentParser, run
from common.markdown import markdown
from common.provenance import ROOT
from evaluation.side_by_side import SIDE_BY_SIDE
from experiments.paper import TABLE5
from experiments.runs import TRACKER_NAMES, mean_and_spread, shown

TABLES = ROOT / "docs" / "tables"
PLACE = re.compile(r"(<!-- table: ([\w-]+) -->\n).*?(<!-- end -->)", re.DOTALL)
COMMAND = re.compile(r"^(Made by )?`[^`]+`\.?$")  # also in the line of the record
EVALUATIONS = {"simulated": "validation", "real": "real"}
DISTANCES = ("0.0", "2.0")  # metres, as the files of evaluations name them
BASELINES = ("sort", "deep_sort", "deep_sort_published", "ab3dmot")
KITTI_RULES = "kitti3d "  # before the name of a figure


def documents() -> list[Path]:
    """The Markdown files that may hold tables."""
    folders = ("tracking", "weights")
    return [
        ROOT / "README.md",
        *sorted((ROOT / "docs").glob("*.md")),
        *(ROOT / folder / "README.md" for folder in folders),
    ]


def filled(text: str, tables: Path, name: str = "README.md") -> str:
    """The text of document `name` with every table as its files in folder `tables` have it."""
    if text.count("<!-- table:") != len(PLACE.findall(text)):
        raise InputError("expected <!-- end --> after each <!-- table: NAME -->", name)
    return PLACE.sub(lambda match: match[1] + _table(tables, match[2]) + match[3], text)


def _table(tables: Path, name: str) -> str:
    if name == "summary":
        return summary(
            *(_read(tables / f"{part}.json")["figures"] for part in EVALUATIONS.values())
        )
    path, record = tables / f"{name}.md", tables / f"{name}.json"
    if not path.is_file():
        return "Not measured yet; the command above makes it.\n"
    lines = path.read_text(encoding="utf-8").splitlines()
    if record.is_file():
        lines = [line for line in lines if not COMMAND.match(line)]
        lines += ["", record_line(_read(record)["run"])]
    lines = [line for line in lines if not line.startswith("# ")]
    lines = [f"**{line[3:]}**" if line.startswith("## ") else line for line in lines]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines).strip()) + "\n"


def record_line(made: dict[str, Any]) -> str:
    """When, from which commit, on which machine and by which command a table was measured."""
    commit, changed = re.fullmatch(r"(\w+)(\+changes)?", made["git_commit"] or "unknown").groups()
    machine, versions = made["machine"], made["versions"]
    processor = machine["processor"] or machine["architecture"]
    cores = f"{machine['cpu_count']} CPU core{'s' if machine['cpu_count'] > 1 else ''}"
    return (
        f"*Measured {made['time_utc'][:10]}, commit {commit[:7]}"
        f"{' with uncommitted changes' if changed else ''}, {cores} "
        f"({processor}), Python {versions['python']}, TensorFlow {versions['tensorflow']}:* "
        f"`{made['command']}`"
    )


def summary(*evaluations: dict[str, list[dict[str, float]]]) -> str:
    """MOTA of every tracker in every evaluation and in the paper; the trackers ahead of ours."""
    columns = [(part, distance) for part in evaluations for distance in DISTANCES]
    heads = [f"{data}, D = {float(d):g} m" for data in (*EVALUATIONS, "paper") for d in DISTANCES]
    lines = []
    for boxes, title in (("", ""), (" on true boxes", ", true boxes")):
        for tracker in SIDE_BY_SIDE:
            name = TRACKER_NAMES[tracker]
            key = f"MOTA@0.5, {tracker}{boxes}"
            if any(key in part[distance][0] for part, distance in columns):
                cells = [shown([f[key] for f in part[d]], 3) for part, d in columns]
                lines.append([name + title, *cells, *_paper(name, "gt" if boxes else "predicted")])
    return markdown(["MOTA, 3-D IoU 0.5", *heads], lines) + "\n" + _behind(evaluations, heads)


def _paper(name: str, boxes: str) -> list[str]:
    rows = TABLE5[boxes].get(name)
    return ["-" if rows is None else f"{rows[float(d)][0]:.3f}" for d in DISTANCES]


def _behind(evaluations: Sequence[dict[str, list[dict[str, float]]]], heads: Sequence[str]) -> str:
    columns = [part[distance] for part in evaluations for distance in DISTANCES]
    parts = []
    for rules, more in (("", ""), (KITTI_RULES, ", by KITTI's rules `kitti3d`")):
        for head, figures in zip(heads, columns, strict=False):
            mota = {
                tracker: mean_and_spread([f.get(f"{rules}MOTA@0.5, {tracker}") for f in figures])[0]
                for tracker in ("pointtracknet", *BASELINES)
            }
            ours = mota.pop("pointtracknet")
            if ours is None:  # without a labelled vehicle, or not measured
                continue
            ahead = [name for name, value in mota.items() if value is not None and value > ours]
            if ahead:
                names = ", ".join(f"{TRACKER_NAMES[name]} {mota[name]:.3f}" for name in ahead)
                parts.append(f"{names} (ours {ours:.3f}; {head}{more})")
    if not parts:
        return "No baseline is ahead of PointTrackNet in these columns.\n"
    return f"**PointTrackNet loses to** {'; '.join(parts)}.\n"


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


def main(argv: Sequence[str] | None = None) -> None:
    """Fills in the tables, or checks them."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="only compare")
    args = parser.parse_args(argv)
    for path in documents():
        found = path.read_text(encoding="utf-8")
        expected = filled(found, TABLES, path.name)
        if args.check and found != expected:
            raise InputError(
                "differs from docs/tables: run python -m experiments.readme_tables", path
            )
        if found != expected:
            write_text(path, expected)


if __name__ == "__main__":
    raise SystemExit(run(main))
