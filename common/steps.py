"""Steps of a long job; a finished step is skipped while its inputs are unchanged."""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from common.config import parse_json
from common.files import write_json
from common.imports import imported_files


class Steps:
    """The finished steps of a folder, stored in `steps.json`.

    Args:
        folder: of the job's output.
    """

    def __init__(self, folder: str | Path):
        self.path = Path(folder) / "steps.json"

    def run(self, name: str, key: str, outputs: Sequence[Path], make: Callable[[], object]) -> bool:
        """Calls `make` unless the step was done under the same key and its outputs exist.

        Returns whether `make` was called. If it raises or is killed, the step counts as not done,
        under a former key too, whose outputs it may have replaced.
        """
        done = self._read()
        if done.get(name) == key and all(path.exists() for path in outputs):
            return False
        if done.pop(name, None) is not None:
            write_json(self.path, done)
        make()
        write_json(self.path, {**self._read(), name: key})
        return True

    def _read(self) -> dict[str, str]:
        try:
            found = parse_json(self.path.read_bytes())
        except (OSError, ValueError):  # missing or damaged: all steps run again
            return {}
        return found if isinstance(found, dict) else {}


def key_of(*parts: object, modules: Iterable[str] = (), files: Iterable[Path] = ()) -> str:
    """A short digest of values (by their repr), of the code that `modules` import, and of files."""
    digest = hashlib.blake2b(repr(parts).encode(), digest_size=8)
    for path in (*imported_files(*modules), *files):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()
