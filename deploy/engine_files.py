"""`write_files`: the files of an engine, which a user may have edited since they were written."""

from collections.abc import Mapping
from pathlib import Path

from common.atomic_file import write_atomically


def files_in(folder: Path) -> dict[str, bytes]:
    """Returns the content of all files in ``folder``, by their paths in it."""
    found = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def write_files(place: Path, files: Mapping[str, bytes]) -> str:
    """Writes ``files``, by their paths in ``place``. Returns a line for the user about those that
    held something else, which is kept beside them as FILE.bak; an empty text if there is none.
    Raises OSError if the system refuses."""
    replaced = []
    for name, content in files.items():
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            if path.read_bytes() == content:
                continue
            replaced.append(name)
        write_atomically(path, content, former=path.with_name(f"{path.name}.bak"))
    if not replaced:
        return ""
    return f"What was different in {place} before is kept as FILE.bak: {', '.join(replaced)}.\n"
