"""Reading triangles and their diffuse colours from COLLADA files, and simplifying them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray, transform_points

GREY = (0.7, 0.7, 0.7)


@dataclass(frozen=True)
class PaintedMesh:
    """``vertices`` (V, 3) metres, ``faces`` (F, 3) indices, ``rgb`` (F, 3) in [0, 1]."""

    vertices: FloatArray
    faces: NDArray[np.int64]
    rgb: FloatArray


def read_collada(path: Path) -> PaintedMesh:
    """All triangles of a file's visual scene, nodes' matrices applied.

    Reads what robot descriptions hold: ``triangles`` and ``polylist`` with float arrays, one matrix a node, diffuse
    colours, the file's unit. Raises :class:`RobotError` when there are none.
    """
    root = ET.parse(path).getroot()
    space = {"c": root.tag.partition("}")[0].strip("{")}
    colours = _material_colours(root, space)
    vertices: list[FloatArray] = []
    faces: list[NDArray[np.int64]] = []
    rgb: list[FloatArray] = []
    count = 0
    for node in root.iterfind(".//c:visual_scene//c:node", space):
        matrix = _numbers(node.findtext("c:matrix", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", space)).reshape(4, 4)
        for instance in node.iterfind("c:instance_geometry", space):
            geometry = root.find(f".//c:geometry[@id='{instance.get('url', '')[1:]}']", space)
            mesh = None if geometry is None else geometry.find("c:mesh", space)
            if mesh is None:
                continue
            for triangles in (*mesh.iterfind("c:triangles", space), *mesh.iterfind("c:polylist", space)):
                points, indices = _triangles(mesh, triangles, space)
                vertices.append(transform_points(matrix, points))
                faces.append(indices + count)
                rgb.append(np.tile(colours.get(triangles.get("material", ""), GREY), (len(indices), 1)))
                count += len(points)
    if not faces:
        raise RobotError(f"No triangles in {path}; a COLLADA file with a visual scene is needed.")
    unit = root.find("c:asset/c:unit", space)
    metres = 1.0 if unit is None else float(unit.get("meter", "1"))
    return PaintedMesh(metres * np.concatenate(vertices), np.concatenate(faces), np.concatenate(rgb))


def thin(mesh: PaintedMesh, cell: float) -> PaintedMesh:
    """The mesh with the vertices of each cube of side ``cell`` (metres) drawn together, flat triangles dropped."""
    cluster = np.unique(_coded(np.floor(mesh.vertices / cell).astype(np.int64)), return_inverse=True)[1]
    size = np.bincount(cluster)
    centres = np.stack([np.bincount(cluster, mesh.vertices[:, k]) / size for k in range(3)], axis=1)
    faces = cluster[mesh.faces]
    a, b, c = faces.T
    solid = (a != b) & (b != c) & (a != c)
    _, first = np.unique(_coded(np.sort(faces[solid], axis=1)), return_index=True)
    return PaintedMesh(centres, faces[solid][first], mesh.rgb[solid][first])


def _coded(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) one number for each row (N, 3), ordered as the rows are: numbers are sorted much faster."""
    low, high = rows.min(axis=0, initial=0), rows.max(axis=0, initial=0)
    return np.asarray(np.ravel_multi_index(tuple((rows - low).T), tuple(high - low + 1)))


def _material_colours(root: ET.Element, space: dict[str, str]) -> dict[str, FloatArray]:
    """Diffuse colour (3,) by material id."""
    effects = {}
    for effect in root.iterfind(".//c:effect", space):
        colour = effect.find(".//c:diffuse/c:color", space)
        if colour is not None and colour.text:
            effects[effect.get("id", "")] = np.clip(_numbers(colour.text)[:3], 0.0, 1.0)
    colours = {}
    for material in root.iterfind(".//c:material", space):
        link = material.find("c:instance_effect", space)
        effect_id = "" if link is None else link.get("url", "")[1:]
        if effect_id in effects:
            colours[material.get("id", "")] = effects[effect_id]
    return colours


def _triangles(
    mesh: ET.Element, triangles: ET.Element, space: dict[str, str]
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Vertices (V, 3) and faces (F, 3) of one ``triangles`` or ``polylist`` element, polygons as fans."""
    inputs = {i.get("semantic"): i for i in triangles.iterfind("c:input", space)}
    stride = 1 + max(int(i.get("offset", "0")) for i in inputs.values())
    corner = inputs["VERTEX"]
    vertices = mesh.find(f"c:vertices[@id='{corner.get('source', '')[1:]}']", space)
    position = None if vertices is None else vertices.find("c:input[@semantic='POSITION']", space)
    source_id = "" if position is None else position.get("source", "")[1:]
    values = mesh.findtext(f"c:source[@id='{source_id}']/c:float_array", "", space)
    corners = triangles.findtext("c:p", "", space).split()[int(corner.get("offset", "0")) :: stride]
    indices = np.fromiter(map(int, corners), dtype=np.int64, count=len(corners))
    sides = _numbers(triangles.findtext("c:vcount", "", space)).astype(np.int64)
    if (sides != 3).any():
        starts = np.cumsum(sides) - sides
        fans = [(s, s + k, s + k + 1) for s, n in zip(starts, sides, strict=True) for k in range(1, n - 1)]
        indices = indices[np.array(fans)]
    return _numbers(values).reshape(-1, 3), indices.reshape(-1, 3)


def _numbers(text: str) -> FloatArray:
    """The numbers in a text, (N,); Python reads them faster than numpy does."""
    return np.fromiter(map(float, text.split()), dtype=np.float64)
