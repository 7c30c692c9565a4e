"""An index on disk, for a fast start: derived data, checked as a whole, thrown away at the least doubt.

A file is one line of JSON (what it is, where each array lies), the arrays, and the CRC-32 of all that:
against accidents, at the speed of reading. Whoever may write here may write to the bank itself.
"""

from __future__ import annotations

import json
import os
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import MemoryStoreError, OutputError
from gvla2.memory.indexing.heap import Heap
from gvla2.memory.indexing.postings import Postings
from gvla2.memory.indexing.rows import COLUMNS, Rows
from gvla2.memory.indexing.vectors import Vectors

FORMAT = "gvla2 memory index 2"
_BEGINNING = json.dumps({"format": FORMAT}).encode()[:30]
_ALIGNED = 64
_DIGEST = 4


def save(path: Path, rows: Rows, about: Mapping[str, Any]) -> None:
    """Write the rows and what they are (``about``: bank, model, place in the chain of events), whole or not at all.

    Dead rows are compacted away first. The file can be read by its owner alone, as it holds all texts.
    """
    if rows.dead:
        rows.compact()
    arrays = _arrays(rows)
    places, offset = {}, 0
    for name, array in arrays.items():
        places[name] = [array.dtype.str, list(array.shape), offset]
        offset += -(-array.nbytes // _ALIGNED) * _ALIGNED
    header = {
        "format": FORMAT,
        "about": dict(about),
        "size": offset,
        "error": rows.vectors.error,
        "skills": list(rows.skills),
        "numbers": list(rows.numbers),
        "arrays": places,
    }
    try:
        _write(path, _parts(header, arrays))
    except OSError as error:
        raise OutputError(
            f"Cannot write the snapshot '{path}': {error.strerror or error}. The memory itself is not touched; "
            "free space there, or do without a snapshot."
        ) from error


def strays_of(path: Path) -> list[Path]:
    """What is left of writers of the snapshot ``path`` that were killed midway; or it is being written just now."""
    try:
        return sorted(file for file in path.parent.iterdir() if file.name.startswith(f".{path.name}."))
    except OSError:
        return []


def discard(path: Path) -> None:
    """Delete a snapshot: it may hold the text of a record that is to be forgotten. What is none is left alone."""
    try:
        if not is_foreign(path):
            path.unlink(missing_ok=True)
    except OSError as error:
        raise MemoryStoreError(
            f"The snapshot '{path}', which may hold the text of what is to be forgotten, cannot be deleted "
            f"({error.strerror or error}): delete it."
        ) from error


def refuse_foreign(path: Path) -> None:
    """Raises :class:`~gvla2.errors.OutputError` where a snapshot would take the place of something else."""
    if is_foreign(path):
        raise OutputError(
            f"'{path}' holds something else than a snapshot of a memory's index: give the path of a new file."
        )


def is_foreign(path: Path) -> bool:
    """Whether something else than a snapshot is at ``path``: a file that begins otherwise, or no plain file."""
    try:
        with path.open("rb") as file:
            begins = file.read(len(_BEGINNING))
    except FileNotFoundError:
        return False
    except OSError:
        return path.exists()
    return bool(begins) and begins != _BEGINNING


def load(path: Path, bank: str, model: str, dimension: int) -> tuple[Rows, dict[str, Any]] | None:
    """The rows and what they are said to be; None for a file that is missing, damaged, or of another bank or model."""
    try:
        with path.open("rb") as file:
            first = file.readline(1 << 26)
            header = json.loads(first)
            about = header["about"]
            if header["format"] != FORMAT or (about["bank"], about["model"]) != (bank, model):
                return None
            # The file's own size, not what the header says: a damaged number must not claim all memory.
            size = os.fstat(file.fileno()).st_size - file.tell() - _DIGEST
            if size != header["size"]:
                return None
            body = np.fromfile(file, np.uint8, size)
            if zlib.crc32(body.data, zlib.crc32(first)).to_bytes(_DIGEST, "little") != file.read():
                return None
        arrays = {
            name: _view(body, np.dtype(kind), shape, offset)
            for name, (kind, shape, offset) in header["arrays"].items()
        }
        rows = _rows(arrays, header)
        return (rows, about) if rows.vectors.dimension == dimension else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, MemoryError):
        return None


def _arrays(rows: Rows) -> dict[str, NDArray[Any]]:
    size = rows.size
    arrays: dict[str, NDArray[Any]] = {f"column/{name}": rows.column(name) for name in COLUMNS}
    arrays |= {f"number/{i}": column[:size] for i, column in enumerate(rows.numbers.values())}
    arrays |= {f"postings/{name}": array for name, array in rows.postings.arrays().items()}
    arrays |= {f"vectors/{name}": array for name, array in rows.vectors.arrays(size).items()}
    arrays |= {
        "sizes": rows.postings.sizes[:size],
        "words": _packed(list(rows.postings.words)),
        "ids": _packed(rows.ids),
        "heap/start": rows.heap.start[:size],
        "heap/size": rows.heap.size[:size],
        "heap/data": np.frombuffer(rows.heap.data, np.uint8),
    }
    return arrays


def _rows(arrays: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> Rows:
    def part(prefix: str) -> dict[str, NDArray[Any]]:
        return {name[len(prefix) :]: array for name, array in arrays.items() if name.startswith(prefix)}

    vectors = part("vectors/")
    rows = Rows(vectors["exact"].shape[1])
    rows.vectors = Vectors.restored(vectors, float(header["error"]))
    rows.postings = Postings.restored(_unpacked(arrays["words"]), arrays["sizes"], part("postings/"))
    rows.heap = Heap.restored(bytearray(arrays["heap/data"].data), arrays["heap/start"], arrays["heap/size"])
    rows.columns = {name: arrays[f"column/{name}"] for name in COLUMNS}
    rows.numbers = {name: arrays[f"number/{i}"] for i, name in enumerate(header["numbers"])}
    rows.skills = {skill: i for i, skill in enumerate(header["skills"])}
    rows.ids = _unpacked(arrays["ids"])
    rows.row_of = {id: row for row, id in enumerate(rows.ids)}
    rows.size = len(rows.ids)
    return rows


def _view(body: NDArray[np.uint8], kind: np.dtype[Any], shape: list[int], offset: int) -> NDArray[Any]:
    size = int(np.prod(shape, dtype=np.int64)) * kind.itemsize
    return body[offset : offset + size].view(kind).reshape(shape)


def _packed(texts: list[str]) -> NDArray[np.uint8]:
    return np.frombuffer(json.dumps(texts).encode(), np.uint8)


def _unpacked(packed: NDArray[np.uint8]) -> list[str]:
    return [str(text) for text in json.loads(packed.tobytes())]


def _parts(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Iterator[bytes | memoryview]:
    yield json.dumps(header).encode() + b"\n"
    for array in arrays.values():
        yield np.ascontiguousarray(array).view(np.uint8).reshape(-1).data
        yield bytes(-array.nbytes % _ALIGNED)


def _write(path: Path, parts: Iterator[bytes | memoryview]) -> None:
    """Write aside in the same folder and replace, so that nobody meets half a file."""
    handle, aside = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            digest = 0
            for part in parts:
                digest = zlib.crc32(part, digest)
                stream.write(part)
            stream.write(digest.to_bytes(_DIGEST, "little"))
        Path(aside).replace(path)
    except BaseException:
        Path(aside).unlink(missing_ok=True)
        raise
