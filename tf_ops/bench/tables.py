"""The tables of tf_ops/README.md, made from the JSON files of the benchmark."""

import json
import re
from pathlib import Path
from typing import Any

from common.files import write_text
from common.markdown import markdown

FOLDER = Path(__file__).resolve().parent.parent
DOCS = FOLDER / "docs"
README = FOLDER / "README.md"
PLACE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

BUILD_KEYS = ("portable_ms", "native_ms", "ratio")

Report = dict[str, Any]  # {"rows": [...], "provenance": {...}}


def peers_table(report: Report) -> str:
    """The ops against the fastest peer, a row for each case."""
    header = ("op", "batch", "tf_ops, ms", "fastest peer", "its ms", "ratio", "goal")
    rows = [
        [
            *(row["case"], row["batch"], f"{row['ours_ms']:.2f}", row.get("peer")),
            *(f"{row[key]:.2f}" if key in row else None for key in ("peer_ms", "ratio")),
            str(row["goal"]),
        ]
        for row in report["rows"]
    ]
    return f"{markdown(header, rows)}\n{moment(report)}"


def builds_table(report: Report) -> str:
    """The portable build against the one for this machine, a row for each case."""
    header = ("op", "batch", "portable, ms", "native, ms", "native / portable")
    rows = [
        [row["case"], row["batch"], *(f"{row[key]:.2f}" for key in BUILD_KEYS)]
        for row in report["rows"]
    ]
    return f"{markdown(header, rows)}\n{moment(report)}"


def moment(report: Report) -> str:
    """Time, machine and method of the measurement."""
    p = report["provenance"]
    times = sorted(row.get("time", p["time_utc"]) for row in report["rows"])
    return (
        f"{p['processor']}, {p['threads']} threads each, medians of {p['calls']} alternating "
        f"calls,\neach after an untimed one; {p['scan']};\n{times[0]} to {times[-1]}, "
        f"commit {str(p['git_commit'])[:7]}."
    )


TABLES = {"bench": peers_table, "native": builds_table}


def filled(text: str, docs: Path = DOCS) -> str:
    """`text` with each `<!-- table: NAME -->` up to `<!-- end -->` holding docs/NAME.json."""

    def table(match: re.Match[str]) -> str:
        report = json.loads((docs / f"{match[2]}.json").read_text(encoding="utf-8"))
        return f"{match[1]}{TABLES[match[2]](report)}\n{match[3]}"

    return PLACE.sub(table, text)


def write() -> None:
    """Updates README.md."""
    write_text(README, filled(README.read_text(encoding="utf-8")))
