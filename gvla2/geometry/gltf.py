"""What lies in a GLB container: chunks, the node tree, and the arrays that accessors describe."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray

Document = dict[str, Any]
"""The JSON part of a glTF file, as parsed."""

_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT = 5126
_INDEX_TYPES: dict[int, np.dtype[Any]] = {
    5121: np.dtype("u1"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
}


def pack(document: Document, binary: bytes) -> bytes:
    """The content of a GLB file."""
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
    chunks = b""
    for kind, body, pad in ((_JSON, text, b" "), (_BIN, binary, b"\0")):
        padded = body + pad * (-len(body) % 4)
        chunks += struct.pack("<II", len(padded), kind) + padded
    return struct.pack("<III", _MAGIC, 2, 12 + len(chunks)) + chunks


def unpack(content: bytes) -> tuple[Document, bytes]:
    """The JSON document and the binary chunk of a GLB file's content."""
    magic, version, length = struct.unpack_from("<III", content)
    if magic != _MAGIC or version != 2:
        raise GeometryError("it is not a GLB file of glTF version 2.")
    if length > len(content):
        raise GeometryError(f"it is truncated: its header says {length} bytes, it has {len(content)}.")
    bodies: dict[int, bytes] = {}
    at = 12
    while at < length:
        size, kind = struct.unpack_from("<II", content, at)
        bodies.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    return json.loads(bodies[_JSON]), bodies.get(_BIN, b"")


def placed_meshes(document: Document) -> Iterator[tuple[FloatArray, int]]:
    """World pose (4, 4) and mesh of each node that has one, in the default scene, depth first."""
    nodes = document.get("nodes", [])
    scenes = document.get("scenes") or [{"nodes": list(range(len(nodes)))}]
    pending = [(np.eye(4), root) for root in reversed(scenes[document.get("scene", 0)].get("nodes", []))]
    visited = 0
    while pending:
        world_from_parent, index = pending.pop()
        visited += 1
        if visited > len(nodes):
            raise GeometryError("its node tree has a loop.")
        world_from_node = world_from_parent @ _local(nodes[index])
        if "mesh" in nodes[index]:
            yield world_from_node, nodes[index]["mesh"]
        pending += [(world_from_node, child) for child in reversed(nodes[index].get("children", []))]


def _local(node: dict[str, Any]) -> FloatArray:
    """parent_from_node (4, 4) of a node's matrix, or of its translation, rotation (xyzw) and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, :3] *= np.asarray(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    pose[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return pose


def inverse(matrix: FloatArray) -> FloatArray:
    """node_from_world (4, 4) of a node's pose, which may scale and shear."""
    if np.linalg.matrix_rank(matrix[:3, :3]) < 3:
        raise GeometryError("a node squeezes its mesh flat (scale 0); its vertices cannot be moved.")
    return np.asarray(np.linalg.inv(matrix))


def _elements(
    document: Document, binary: bytes | bytearray, accessor: int, kind: np.dtype[Any], width: int
) -> NDArray[Any]:
    """An accessor's elements (count, width) as they lie in the binary chunk, interleaved or not."""
    entry = document["accessors"][accessor]
    if "sparse" in entry or "bufferView" not in entry:
        raise GeometryError("it stores vertices sparsely; export it with plain accessors.")
    view = document["bufferViews"][entry["bufferView"]]
    if view.get("buffer", 0) != 0 or "uri" in document["buffers"][0]:
        raise GeometryError("its vertices lie in another file; only GLB files that hold them are read.")
    stride = view.get("byteStride", kind.itemsize * width)
    offset = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
    if entry["count"] and offset + stride * (entry["count"] - 1) + kind.itemsize * width > len(binary):
        raise GeometryError("it is truncated: vertices lie beyond its end.")
    return np.ndarray((entry["count"], width), kind, binary, offset, (stride, kind.itemsize))


def read_floats(document: Document, binary: bytes | bytearray, accessor: int) -> FloatArray:
    """(N, 3) positions or normals, in double precision."""
    if document["accessors"][accessor]["componentType"] != _FLOAT:
        raise GeometryError("its vertices are quantised; export it with float positions and normals.")
    return _elements(document, binary, accessor, np.dtype("<f4"), 3).astype(np.float64)


def store_floats(document: Document, binary: bytearray, accessor: int, values: FloatArray) -> None:
    """Overwrite positions or normals (N, 3) where they lie, as float32."""
    _elements(document, binary, accessor, np.dtype("<f4"), 3)[:] = values


def read_faces(document: Document, binary: bytes, accessor: int | None, vertices: int) -> NDArray[np.int64]:
    """(F, 3) vertex indices; without an accessor the vertices are taken three by three."""
    if accessor is None:
        return np.arange(vertices - vertices % 3).reshape(-1, 3)
    kind = _INDEX_TYPES[document["accessors"][accessor]["componentType"]]
    faces = _elements(document, binary, accessor, kind, 1).reshape(-1, 3)
    return np.asarray(faces, dtype=np.int64)
