"""The tables of tf_ops/README.md, made from the JSON files that the benchmark has written."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from common.files import write_text

FOLDER = Path(__file__).resolve().parent.parent
DOCS = FOLDER / "docs"
README = FOLDER / "README.md"
PLACE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

Report = dict[str, Any]  # {"rows": [...], "provenance": {...}}


def peers_table(report: Report) -> str:
    """Ours against the best peer, a row for each case."""
    lines = ["| op | batch | ours, ms | best peer | its ms | ratio | goal |"]
    lines.append("|---|---|---|---|---|---|---|")
    for row in report["rows"]:
        peer = "| - | - | - |"
        if "peer" in row:
            peer = f"| {row['peer']} | {row['peer_ms']:.2f} | {row['ratio']:.2f} |"
        lines.append(
            f"| {row['case']} | {row['batch']} | {row['ours_ms']:.2f} {peer} {row['goal']} |"
        )
    return "\n".join([*lines, "", moment(report)])


def builds_table(report: Report) -> str:
    """The portable build against the one for this machine, a row for each case."""
    lines = [
        "| op | batch | portable, ms | native, ms | native / portable |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {row['case']} | {row['batch']} | {row['portable_ms']:.2f} | {row['native_ms']:.2f} "
        f"| {row['ratio']:.2f} |"
        for row in report["rows"]
    ]
    return "\n".join([*lines, "", moment(report)])


def moment(report: Report) -> str:
    """When, where and how the figures were taken."""
    p = report["provenance"]
    times = sorted(row.get("time", p["time_utc"]) for row in report["rows"])
    return (
        f"{p['processor']}, {p['threads']} threads each, medians of {p['calls']} calls that take "
        f"turns,\neach right after an untimed one; {p['scan']};\n{times[0]} to {times[-1]}, "
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
    """Brings README.md up to date."""
    write_text(README, filled(README.read_text(encoding="utf-8")))
