"""Results in an object store (``s3://...``): a folder here, and its copy there.

An object store has no locks, no links and no files that grow, all of which playing needs. So a
comparison is played in a folder here (:func:`kept`). What is in the store comes first, and
is not played again; each finished cell goes there as a whole file. In this way, shards on machines
that share no disk can fill one place: a cell has one name and one content, whichever of them writes
it. Checkpoints stay here, so an interrupted cell continues only on this machine.

`fsspec <https://filesystem-spec.readthedocs.io>`_ knows the stores: ``s3://`` with the extra
``s3``, ``gs://`` with the package ``gcsfs``, ``az://`` with ``adlfs``.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

from causal_openlock.errors import StoreError, in_short
from causal_openlock.files.atomic import PARTIAL, folder_at, write_bytes
from causal_openlock.storage.store import Store

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://.+", re.DOTALL)
_COMES = re.compile(
    r"experiment\.json|(cells|reactions|structures)/[^/]+\.parquet|transcripts/[^/]+\.jsonl"
    r"|errors/[^/]+\.txt|code(/[\w.-]+)+",
    re.ASCII,
)
_OF_CELLS = ("cells", "reactions", "structures", "transcripts")
_USER = re.compile(r"(?<=://)[^/]*:[^/]*@")
_STAYS = re.compile(r"\.lock.*|.*\.(checkpoint|attempts|progress)|\.awaited-.*")


def is_remote(place: str | Path) -> bool:
    """Whether results are kept in a store rather than in a folder.

    >>> is_remote("s3://bucket/human"), is_remote("results/human")
    (True, False)
    """
    return _URL.fullmatch(str(place)) is not None


def without_password(place: str | Path) -> str:
    """A place as messages show it.

    >>> without_password("ftp://me:secret@host/human")
    'ftp://host/human'
    """
    return _USER.sub("", str(place))


def local_folder(place: str | Path) -> Path:
    """The folder itself, or where a store's results are played and read, in ``results/``.

    >>> local_folder("s3://bucket/human").name
    'human-39c6c231'
    """
    if not is_remote(place):
        return Path(place)
    url = str(place).rstrip("/")
    name = re.sub(r"[^\w.-]", "_", without_password(url).rpartition("/")[2], flags=re.ASCII).lstrip(
        "."
    )
    return Path("results") / f"{name}-{hashlib.sha256(url.encode()).hexdigest()[:8]}"


def downloaded(place: str | Path) -> Path:
    """The folder itself, or one with what a store holds of a comparison.

    Raises:
        StoreError: If the store cannot be reached.
    """
    with kept(place) as (folder, _):
        return folder


@contextmanager
def kept(place: str | Path) -> Iterator[tuple[Path, Callable[[], None]]]:
    """Yield the folder to play in, and a function that uploads new files to the store.

    Raises:
        StoreError: If the folder is a file, or a store cannot be reached.
    """
    if not is_remote(place):
        yield folder_at(place), lambda: None
        return
    remote = Remote(str(place))
    remote.download()
    yield remote.folder, remote.upload


class Remote:
    """The results of a comparison in a store.

    Args:
        url: Where: the protocol of fsspec, and the path of what serves as a folder.

    Raises:
        StoreError: If the store is not known, or what it needs is not installed.
    """

    def __init__(self, url: str) -> None:
        self.url, self.folder, self.shown = url, local_folder(url), without_password(url)
        self._sent: dict[str, tuple[int, int]] = {}
        with self._reached():
            import fsspec

            self._files, self._root = fsspec.core.url_to_fs(url)

    def download(self) -> None:
        """Download the description, cells and the files next to them, and reasons of failures.

        A cell that is whole here is not replaced; where it differs there, it is sent again.

        Raises:
            StoreError: If the store cannot be reached.
        """
        with self._reached():
            found: dict[str, Any] = self._files.find(self._root, detail=True)
            whole = cache(self._is_whole)
            # What is beside a cell comes before it: whether to bring it depends on the cell here.
            for path, about in sorted(found.items(), reverse=True):
                inside = str(PurePosixPath(path).relative_to(PurePosixPath(self._root)))
                if not _COMES.fullmatch(inside) or ".." in PurePosixPath(inside).parts:
                    continue  # names in a store may be anything
                here = self.folder / inside
                # Only the description is rewritten in place; of the others, what is complete stays.
                known = here.is_file() and here.stat().st_size == about["size"]
                of_cell = inside.split("/")[0] in _OF_CELLS
                if not known and of_cell and here.is_file() and whole(here.stem):
                    continue  # what is there is cut off, or of another program
                if not known or inside == "experiment.json":
                    write_bytes(here, self._files.cat_file(path))
                self._sent[inside] = _state(here)

    def _is_whole(self, cell: str) -> bool:
        """Whether a cell's record is here and undamaged."""
        store = Store(self.folder)
        try:
            store.read(store.cells / f"{cell}.parquet")
        except StoreError:
            return False
        return True

    def upload(self) -> None:
        """Send what is new or has changed here, the description first.

        Raises:
            StoreError: If the store cannot be written to; what is here stays.
        """
        here = (path for path in self.folder.rglob("*") if path.is_file())
        for path in sorted(here, key=lambda one: (one.name != "experiment.json", one)):
            inside = path.relative_to(self.folder).as_posix()
            if _STAYS.fullmatch(path.name) or path.match(PARTIAL):
                continue
            if self._sent.get(inside) != (now := _state(path)):
                with self._reached():
                    self._files.pipe_file(f"{self._root}/{inside}", path.read_bytes())
                self._sent[inside] = now

    @contextmanager
    def _reached(self) -> Iterator[None]:
        try:
            yield
        except ImportError as error:
            raise StoreError(
                f"{self.shown} needs a package that is not installed ({in_short(error)}); install "
                "it, for s3:// with: pip install 'causal-openlock[s3]'"
            ) from None
        except Exception as error:  # each store has errors of its own
            why = in_short(error).replace(self.url, self.shown)
            raise StoreError(
                f"{self.shown} cannot be reached ({type(error).__name__}: {why}); check "
                f"the address and what it needs. What was played is in {self.folder}, and the same "
                "command continues"
            ) from None


def _state(path: Path) -> tuple[int, int]:
    """Size and time of a file, which change when it is rewritten."""
    about = path.stat()
    return about.st_size, about.st_mtime_ns
