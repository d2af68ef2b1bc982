"""Puts the tables of docs/tables into README.md, so that no figure there is typed by hand.

    python -m experiments.readme_tables          write them
    python -m experiments.readme_tables --check  fail if README.md differs from them

In README.md a table stands between `<!-- table: NAME -->` and `<!-- end -->`; it is what
docs/tables/NAME.md holds, without its title. Where that file is not there, one line says which
experiment makes it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from common.errors import InputError
from common.files import write_text
from common.flags import ArgumentParser, run
from common.provenance import ROOT

PLACE = re.compile(r"(<!-- table: ([\w-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(readme: str, tables: Path) -> str:
    """The text of README.md with every table as its file has it."""
    if readme.count("<!-- table:") != len(PLACE.findall(readme)):
        raise InputError("expected <!-- end --> after each <!-- table: NAME -->", "README.md")
    return PLACE.sub(lambda match: match[1] + _table(tables / f"{match[2]}.md") + match[3], readme)


def _table(path: Path) -> str:
    if not path.is_file():
        return f"No figures here yet: `python -m experiments.{path.stem}` measures them.\n"
    lines = path.read_text(encoding="utf-8").splitlines()
    lines = [line for line in lines if not line.startswith("# ")]
    lines = [f"**{line[3:]}**" if line.startswith("## ") else line for line in lines]
    return "\n".join(lines).strip() + "\n"


def main(argv: Sequence[str] | None = None) -> None:
    """Fills in the tables, or checks them."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="only compare")
    args = parser.parse_args(argv)
    path = ROOT / "README.md"
    found = path.read_text(encoding="utf-8")
    expected = filled(found, ROOT / "docs" / "tables")
    if args.check and found != expected:
        raise InputError("differs from docs/tables: run python -m experiments.readme_tables", path)
    if not args.check:
        write_text(path, expected)


if __name__ == "__main__":
    raise SystemExit(run(main))
