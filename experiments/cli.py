"""What the tracking experiments have in common: flags, and the two files each of them writes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from common import flags
from common.files import write_json, write_text
from common.provenance import provenance
from evaluation.config import parse_names
from evaluation.run import check_writable
from kitti.splits import parse_sequences


def make_parser(doc: str, seqs: str = "0016-0020") -> flags.ArgumentParser:
    """--data_root, --seqs and --out; a script adds its own."""
    parser = flags.ArgumentParser(description=doc.split("\n", maxsplit=1)[0])
    parser.add_argument("--data_root", type=Path, required=True, help="KITTI's tracking layout")
    parser.add_argument("--seqs", default=seqs, help="such as 0016-0020")
    parser.add_argument("--out", type=Path, required=True, help="folder for the files written")
    return parser


def add_displacement_flags(parser: flags.ArgumentParser) -> None:
    """--classes and --seeds."""
    parser.add_argument("--classes", default="Car", help="tracked, and evaluated on both sides")
    parser.add_argument("--seeds", type=flags.positive_int, default=5, help="of the displacement")


def common_fields(args: argparse.Namespace) -> dict[str, Any]:
    """Fields of `runs.Run` that the flags give; `--out` is checked on the way."""
    check_writable(args.out)
    return {
        "data_root": args.data_root,
        "seqs": tuple(parse_sequences(args.seqs)),
        "classes": parse_names(args.classes),
    }


def write(out: Path, name: str, title: str, tables: str, figures: Any) -> None:
    """`name.md` and `name.json`, the command that made them in both."""
    record = provenance()
    write_text(out / f"{name}.md", f"# {title}\n\nMade by `{record['command']}`.\n\n{tables}")
    write_json(out / f"{name}.json", {"run": record, "figures": figures})
    print(tables, end="")
