"""Writing without half-written files: to a temporary name in the same folder, to the disk, then renamed."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flexplant.errors import WriteError


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary path with the same ending beside `path`, which it replaces when the block ends without an error.

    After any error, Ctrl-C included, `path` is as it was before and the temporary file is gone. Raises WriteError naming the
    folder that is missing or cannot be written.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise WriteError(f"cannot write {path}: this is a folder; give a file name")
        if not path.parent.is_dir():
            raise WriteError(f"cannot write {path}: there is no folder {path.parent}")
    except (OSError, ValueError) as error:  # a name too long, a NUL in it
        raise WriteError(f"cannot write {str(path)[:60]}...: {getattr(error, 'strerror', None) or error}") from None
    work = path.with_name(f".{uuid.uuid4().hex[:12]}.part{path.suffix}")
    try:
        yield work
        _to_disk(work)
        work.replace(path)
    except OSError as error:
        raise WriteError(f"cannot write {path} in the folder {path.parent}: {error.strerror or error}") from None
    finally:
        work.unlink(missing_ok=True)


def _to_disk(path: Path) -> None:
    with path.open("rb+") as stream:
        os.fsync(stream.fileno())
