"""Mesh files: one reader for everything that needs a mesh, and a writer, on trimesh.

GLB, glTF and COLLADA files say which way is up and are turned to our Z-up frame; the others are taken as they are. A
COLLADA file also says its unit.
"""

from __future__ import annotations

import codecs
import errno
import io
import json
import logging
import os
import re
import struct
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from gvla2.errors import GeometryError, MissingDependencyError, reading
from gvla2.geometry.mesh import GREY, TexturedMesh, TriangleMesh
from gvla2.geometry.polygons import triangles_of, without_polygons
from gvla2.geometry.transform import FloatArray
from gvla2.io.files import write_whole

READABLE = (".obj", ".glb", ".gltf", ".ply", ".stl", ".dae", ".off")
WRITABLE = (".obj", ".glb", ".ply")
_GLTF = (".glb", ".gltf")
_UNREADABLE = {
    *("EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_mesh_quantization"),
    "EXT_mesh_gpu_instancing",
}
_READ = {"KHR_draco_mesh_compression", "KHR_texture_transform", "EXT_texture_webp", "KHR_lights_punctual"}
"""Extensions of glTF that trimesh would misread, and those that may be required; of Draco it asks DracoPy."""
_EXACT = {"TEXCOORD_0": "_UV", "COLOR_0": "_RGB"}
"""Attributes of glTF, and the names under which trimesh keeps them as they are."""
_TURNS: Mapping[str, FloatArray] = {
    "X_UP": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "Y_UP": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}
"""(3, 3) from a file's frame to the Z-up frame."""

log = logging.getLogger(__name__)


def to_y_up(points: ArrayLike) -> FloatArray:
    """Our points or directions (..., 3) in the frame of glTF: (x, y, z) becomes (x, z, -y)."""
    return np.asarray(points, dtype=np.float64) @ _TURNS["Y_UP"]


def to_z_up(points: ArrayLike) -> FloatArray:
    """Points or directions (..., 3) of glTF in our frame: (x, y, z) becomes (x, -z, y)."""
    return np.asarray(points, dtype=np.float64) @ _TURNS["Y_UP"].T


def read_mesh(path: str | os.PathLike[str], up: Literal["file", "z"] = "file") -> TriangleMesh:
    """As :func:`read_textured_mesh`, with one colour a vertex; ``colours`` is None where the file has none."""
    return read_textured_mesh(path, up).coloured()


def read_textured_mesh(path: str | os.PathLike[str], up: Literal["file", "z"] = "file") -> TexturedMesh:
    """All triangles of a file as one mesh, placed by its scene graph, in metres where the file says its unit.

    Reads :data:`READABLE`: textures, colours of vertices and faces, materials with a colour alone, polygons, several
    materials. Vertices that coincide are one, vertices that no face uses are dropped. ``up="z"`` ignores the up axis
    that a COLLADA file states, as the tools for URDFs do.

    Raises :class:`GeometryError`, naming the file, when it is absent, of another kind, broken, without triangles, or
    compressed in a way that isn't read; :class:`MissingDependencyError` for a COLLADA file without pycollada.
    """
    source = Path(path)
    suffix = _suffix(source, READABLE)
    with reading("a mesh", source):  # trimesh's parsers and visuals raise anything
        scene, from_file, uv_moves = _load(source, suffix, up)
        pieces = [p for p in scene.dump() if isinstance(p, trimesh.Trimesh) and len(p.faces)]
        if not pieces:
            raise GeometryError("it holds no triangles.")
        looks = [_look(piece, uv_moves) for piece in pieces]
        vertices, faces = np.unique(np.concatenate(list(map(_corners, pieces))), axis=0, return_inverse=True)
        mesh = TriangleMesh(vertices @ from_file.T, faces.reshape(-1, 3))
        if not all(np.isfinite(uv).all() and np.isfinite(rgb).all() for uv, rgb, _ in looks):
            raise GeometryError("its colours or texture coordinates are not finite.")
    images = [image for _, _, image in looks if image is not None]
    numbers = np.cumsum([image is not None for _, _, image in looks]) - 1
    texture = [-1 if image is None else number for number, (_, _, image) in zip(numbers, looks, strict=True)]
    return TexturedMesh(
        mesh,
        np.concatenate([uv for uv, _, _ in looks]),
        np.repeat(np.array(texture, dtype=np.int64), [len(piece.faces) for piece in pieces]),
        np.concatenate([rgb for _, rgb, _ in looks]),
        tuple(images),
    )


def write_mesh(path: str | os.PathLike[str], mesh: TriangleMesh) -> None:
    """Write vertices, faces and colours, whole or not at all; the suffix .obj, .glb or .ply chooses the format.

    Raises :class:`GeometryError` for another suffix, :class:`gvla2.errors.OutputError` when it cannot be written.
    """
    suffix = _suffix(Path(path), WRITABLE)
    vertices = to_y_up(mesh.vertices) if suffix == ".glb" else mesh.vertices
    colours = None if mesh.colours is None else np.rint(255 * mesh.colours).astype(np.uint8)
    built = trimesh.Trimesh(vertices, mesh.faces, vertex_colors=colours, process=False)
    content = built.export(file_type=suffix[1:])
    write_whole(path, content.encode() if isinstance(content, str) else content)


_Moves = Mapping[str, FloatArray]
"""(3, 3) by a material's name: where its texture coordinates lie on its image, v downwards."""


def _load(source: Path, suffix: str, up: Literal["file", "z"]) -> tuple[trimesh.Scene, FloatArray, _Moves]:
    """The file's scene as it is, the matrix (3, 3) that takes its points to our frame, metres, and its materials'."""
    if not source.is_file():
        raise GeometryError("there is no such file.")
    content = source.read_bytes().removeprefix(codecs.BOM_UTF8)
    resolver, from_file = _BesideResolver(source), np.eye(3)
    moves: _Moves = {}
    if suffix == ".dae":
        content, from_file = _plain_collada(source, content, up)
    elif suffix in _GLTF:
        content, moves = _plain_gltf(content)
        from_file = _TURNS["Y_UP"]
    elif suffix == ".obj":
        content = _plain_obj(content, resolver)
    elif suffix == ".ply":
        content = _plain_ply(content)
    elif suffix == ".stl":
        content = _plain_stl(content)
    elif suffix == ".off":
        return _read_off(_decoded(content)).scene(), from_file, moves
    kind = suffix.removeprefix(".")
    scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=resolver, process=False)
    if resolver.too_large:
        raise GeometryError(resolver.too_large)
    return scene, from_file, moves


class _BesideResolver(trimesh.resolvers.FilePathResolver):  # type: ignore[misc]
    """Finds a mesh's materials and pictures by the names that other systems write: Windows' paths, ``%20``, another
    case, another machine's folders.

    ``materials`` is the text of an OBJ file's material libraries, joined; ``too_large`` names a picture that is, and
    that trimesh would leave out.
    """

    materials, too_large = b"", ""

    def get(self, name: str) -> bytes:
        """The content of the file of that name, or of the one of its last part beside the mesh."""
        if name == _MATERIALS:
            return self.materials
        folder, words = Path(self.parent), unquote(name.strip().strip('"')).replace("\\", "/")
        last = Path(words).name.casefold()
        named = [folder / each for each in (name.strip(), words) if not Path(each).is_absolute()]
        beside = [each for each in sorted(folder.iterdir()) if each.name.casefold() == last]
        found = next((each for each in (*named, *beside) if each.is_file()), None)
        if found is None:
            log.warning("%s names %s, which is not beside it.", self.clean, name)
            raise FileNotFoundError(errno.ENOENT, f"{name} is not beside it")
        content = found.read_bytes()
        if why := _too_large(content):
            self.too_large = f"its picture {found} is too large: {why}"
        return content.removeprefix(codecs.BOM_UTF8)


def _too_large(content: bytes) -> str:
    """Why a picture would fill the memory; "" for one that does not, and for what is none."""
    try:
        with suppress(OSError), warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            Image.open(io.BytesIO(content))
    except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
        return str(error)
    return ""


_MATERIALS, _PLAIN = "gvla2_materials", "gvla2_plain"
"""The names of the joined libraries, and of the material of faces whose own is in none."""
_OPTIONS = r"(?:\s+-(?:[sot](?:\s+[-+\d.eE]+){1,3}|mm\s+\S+\s+\S+|[a-z]+\s+\S+))*\s+"
"""The options of a picture in a material library."""


def _plain_obj(content: bytes, resolver: _BesideResolver) -> bytes:
    """An OBJ file as trimesh reads it: single spaces, no comments behind numbers, one library that has every material.

    Faces whose material is in no library, or that have none, have no colour of their own.
    """
    text = "\n" + re.sub(r"\r\n?", "\n", _decoded(content)).replace("\\\n", " ")
    if "\t" in text or "\n " in text:
        text = re.sub(r"\n +", "\n", re.sub(r"[ \t]*\t[ \t]*", " ", text))
    if text.count("#") > text.count("\n#"):
        text = re.sub(r"(\n(?:v|vt|vn|f) [^#\n]*)#.*", r"\1", text)
    if zero := re.search(r"\nf .*(?<= )0(?!\d).*", text):
        raise GeometryError(f"'{zero[0][1:60]}' names vertex 0; an OBJ file counts from 1.")
    text = without_polygons(text)
    libraries = []
    for name in re.findall(r"\nmtllib (.+)", text):
        for each in dict.fromkeys((name, *name.split())):
            try:
                libraries.append(_decoded(resolver.get(each)))
            except FileNotFoundError:
                continue
            break
    library = re.sub(rf"(?mi)^(\s*map_kd){_OPTIONS}", r"\1 ", "\n".join(libraries))
    text = re.sub(r"\nmtllib .*", "", text)
    known = {" ".join(name.split()) for name in re.findall(r"(?mi)^\s*newmtl (.+)$", library)}
    plain = f"\nusemtl {_PLAIN}"
    text = re.sub(r"\nusemtl (.+)", lambda use: use[0] if " ".join(use[1].split()) in known else plain, text)
    if re.search(r"\nf \S*\d/\d", text) and "\nusemtl " not in text[: text.find("\nf ")]:
        text = plain + text
    resolver.materials = f"{library}\nnewmtl {_PLAIN}\nKd 1 1 1\n".encode()
    return f"mtllib {_MATERIALS}{text}".encode()


def _plain_ply(content: bytes) -> bytes:
    """A PLY file with the usual names of colours, and without texture coordinates where it names no picture."""
    header, end, body = content.partition(b"end_header")
    header = re.sub(rb"(?m)^(property \w+ )(?:diffuse_)(red|green|blue)\b", rb"\1\2", header)
    for short, name in ((b"r", b"red"), (b"g", b"green"), (b"b", b"blue")):
        header = re.sub(rb"(?m)^(property \w+ )" + short + rb"(\r?)$", rb"\1" + name + rb"\2", header)
    if b"TextureFile" not in header:
        header = re.sub(rb"(?m)^(property .*\b)([stuv]|texture_[uv]|texcoord)(\r?)$", rb"\1no_\2\3", header)
    return header + end + body


def _plain_stl(content: bytes) -> bytes:
    """A binary STL file without what follows its triangles, for which trimesh would take it for text.

    Raises :class:`GeometryError` for one that ends before its last triangle.
    """
    if len(content) < 84 or b"facet" in content[84:2000].lower():
        return content
    count = struct.unpack_from("<I", content, 80)[0]
    if len(content) < 84 + 50 * count:
        raise GeometryError(
            f"it is no STL file, or cut: its {len(content)} bytes do not hold {count} triangles."
        )
    return content[: 84 + 50 * count] if count else content


def _read_off(text: str) -> trimesh.Trimesh:
    """An OFF file with the colours of its vertices (COFF) or faces, which trimesh leaves out.

    A vertex has its position, then its normal (NOFF), then its colour; a face its corners, then its colour.
    """
    header = re.match(r"\s*(C?)(N?)OFF(?!\s*BINARY)", text)
    if header is None:
        raise GeometryError("it begins with neither OFF, COFF, NOFF nor CNOFF and text; export it so.")
    lines = (re.sub(r"#.*", "", line).split() for line in text[header.end() :].splitlines())
    counts, *rows = (line for line in lines if line)
    vertices, polygons = rows[: int(counts[0])], rows[int(counts[0]) : int(counts[0]) + int(counts[1])]
    corners = [row[1 : 1 + int(row[0])] for row in polygons]
    if any(
        len(polygon) != int(row[0]) or len(polygon) < 3
        for polygon, row in zip(corners, polygons, strict=True)
    ):
        raise GeometryError("a face has fewer than three corners, or fewer than it says.")
    points = np.array([row[:3] for row in vertices], np.float64)
    cut = [(polygon, triangles_of(points[np.array(polygon, np.int64)])) for polygon in corners]
    fans = [[polygon[k] for k in triangle] for polygon, triangles in cut for triangle in triangles]
    own = [row[1 + int(row[0]) :] for row in polygons for _ in range(int(row[0]) - 2)]
    begin = 6 if header[2] else 3
    painted = [row[begin:] for row in vertices] if header[1] else []
    mesh = trimesh.Trimesh(points, np.array(fans, np.int64), process=False)
    if painted:
        mesh.visual.vertex_colors = _off_colours(painted)
    elif own and all(len(colour) >= 3 for colour in own):
        mesh.visual.face_colors = _off_colours(own)
    return mesh


def _off_colours(words: Sequence[Sequence[str]]) -> NDArray[np.uint8]:
    """(N, 3) from numbers up to 255, or from shares, which have a point."""
    colours = np.array([row[:3] for row in words], np.float64)
    return np.rint(np.clip(colours * (255 if "." in "".join(map("".join, words)) else 1), 0, 255)).astype(
        np.uint8
    )


def _decoded(content: bytes) -> str:
    try:
        return content.decode()
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _plain_collada(source: Path, content: bytes, up: Literal["file", "z"]) -> tuple[bytes, FloatArray]:
    """A COLLADA file with its namespace, and the matrix (3, 3) that takes its points to our frame, metres."""
    try:
        import collada  # noqa: F401  # trimesh's reader of COLLADA
    except ImportError as error:
        raise MissingDependencyError(
            "the package 'pycollada'", f"Reading {source}", "pip install pycollada"
        ) from error
    root = ET.fromstring(content)
    tag = "{*}" if root.tag.startswith("{") else ""
    unit, axis = root.find(f"{tag}asset/{tag}unit"), root.findtext(f"{tag}asset/{tag}up_axis") or ""
    turn = _TURNS.get(axis.strip() if up == "file" else "Z_UP", np.eye(3))
    _drop_dangling(root)
    if not tag:  # pycollada knows elements by their namespace alone
        root.set("xmlns", "http://www.collada.org/2005/11/COLLADASchema")
    return ET.tostring(root), turn * (1.0 if unit is None else float(unit.get("meter", 1.0)))


def _drop_dangling(root: ET.Element) -> None:
    """Take out materials and textures that refer to what the file lacks, else pycollada leaves out their geometry.

    Raises :class:`GeometryError` for a geometry or node that is placed and missing.
    """
    ids = {f"#{element.get('id')}" for element in root.iter() if element.get("id")}
    for effect in root.iterfind(".//{*}effect"):
        named = {str(element.get("sid")) for element in effect.iter()} | {name[1:] for name in ids}
        for parent in list(effect.iter()):
            for child in list(parent):
                source = child.findtext("{*}sampler2D/{*}source") or child.findtext("{*}surface/{*}init_from")
                if source is not None and source.strip() not in named:
                    parent.remove(child)
                    named.discard(str(child.get("sid")))
        for shader in effect.iterfind(".//{*}technique/*"):
            glow = shader.find("{*}emission")
            if glow is not None and shader.find("{*}diffuse") is None:  # unlit: what it emits is its colour
                glow.tag = glow.tag.replace("emission", "diffuse")
        for parent in list(effect.iter()):
            for child in parent.findall("{*}texture"):
                if child.get("texture") not in named:
                    child.tag = child.tag.replace("texture", "color")
                    child.attrib.clear()
                    child.text = "1 1 1 1"
    for tag, key in (("instance_effect", "url"), ("instance_material", "target")):
        for parent in list(root.iter()):
            for child in parent.findall(f"{{*}}{tag}"):
                if child.get(key) not in ids:
                    ids.discard(f"#{parent.get('id')}")
                    parent.remove(child)
    for materials in root.iterfind("{*}library_materials"):
        for material in list(materials):
            if f"#{material.get('id')}" not in ids:
                materials.remove(material)
    for element in (*root.iterfind(".//{*}instance_geometry"), *root.iterfind(".//{*}instance_node")):
        url = element.get("url", "")
        if url.startswith("#") and url not in ids:
            raise GeometryError(f"it places {url[1:]}, which it does not hold.")


def _plain_gltf(content: bytes) -> tuple[bytes, dict[str, FloatArray]]:
    """A glTF file as trimesh reads it: its materials named by their numbers, the texture coordinates that the colour
    uses as the first set, specular-glossiness as a base colour; and each material's transform of texture coordinates.

    Raises :class:`GeometryError` for what trimesh would misread or leave out.
    """
    binary, rest = content[:4] == b"glTF", b""
    text = content
    if binary:
        (length,) = struct.unpack_from("<I", content, 12)
        text, rest = content[20 : 20 + length], content[20 + length :]
    tree = json.loads(text)
    required = {e for e in tree.get("extensionsRequired", ()) if not e.startswith("KHR_materials_")} - _READ
    if found := sorted(required | _UNREADABLE & set(tree.get("extensionsUsed", ()))):
        raise GeometryError(f"it uses {', '.join(found)}, which is not read; export it without.")
    meshes, nodes = tree.get("meshes", ()), tree.get("nodes", ())
    primitives = [primitive for mesh in meshes for primitive in mesh["primitives"]]
    unread = {
        "sparse accessors": any("sparse" in accessor for accessor in tree.get("accessors", ())),
        "triangle fans": any(primitive.get("mode") == 6 for primitive in primitives),
        "skins": any("skin" in node for node in nodes),
        "weighted morph targets": any(any(each.get("weights", ())) for each in (*meshes, *nodes)),
    }
    if there := [what for what, has in unread.items() if has]:
        raise GeometryError(f"it has {' and '.join(there)}, which are not read; export it without.")
    for image in tree.get("images", ()) if binary else ():
        view = tree["bufferViews"][image["bufferView"]] if "bufferView" in image else {"byteLength": 0}
        begin = 8 + view.get("byteOffset", 0)  # behind the head of the binary chunk
        if why := _too_large(rest[begin : begin + view["byteLength"]]):
            raise GeometryError(f"its picture '{image.get('name', '')}' is too large: {why}")
    moves: dict[str, FloatArray] = {}
    sets: dict[int, int] = {}
    for number, material in enumerate(tree.get("materials", ())):
        material["name"] = str(number)
        base = material.setdefault("pbrMetallicRoughness", {})
        glossy = material.get("extensions", {}).pop("KHR_materials_pbrSpecularGlossiness", {})
        for own, name in (("diffuseFactor", "baseColorFactor"), ("diffuseTexture", "baseColorTexture")):
            if own in glossy:
                base[name] = glossy[own]
        texture = base.get("baseColorTexture", {})
        move = texture.get("extensions", {}).get("KHR_texture_transform", {})
        sets[number] = move.get("texCoord", texture.get("texCoord", 0))
        if move:
            scale, (x, y) = move.get("scale", (1.0, 1.0)), move.get("offset", (0.0, 0.0))
            c, s = np.cos(move.get("rotation", 0.0)), np.sin(move.get("rotation", 0.0))
            turn = np.array([[c, s, x], [-s, c, y], [0.0, 0.0, 1.0]])
            moves[str(number)] = turn @ np.diag([*scale, 1.0])
    for primitive in primitives:
        if wanted := sets.get(primitive.get("material"), 0):
            draco = primitive.get("extensions", {}).get("KHR_draco_mesh_compression", {})
            for attributes in filter(None, (primitive["attributes"], draco.get("attributes"))):
                first = attributes.pop("TEXCOORD_0", None)
                attributes["TEXCOORD_0"] = attributes.get(f"TEXCOORD_{wanted}", first)
        # Trimesh takes integers for what they are, not for shares of their range.
        for name, own in _EXACT.items():
            at = primitive["attributes"].get(name)
            accessor = {} if at is None else tree["accessors"][at]
            if accessor.get("normalized") and "bufferView" in accessor:
                primitive["attributes"][own] = at
    text = json.dumps(tree).encode()
    if not binary:
        return text, moves
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    return head + text + rest, moves


def _suffix(path: Path, known: tuple[str, ...]) -> str:
    suffix = path.suffix.lower()
    if suffix not in known:
        raise GeometryError(f"{path}: meshes are {', '.join(known)} files, not '{suffix}'.")
    return suffix


def _corners(piece: trimesh.Trimesh) -> FloatArray:
    """(3F, 3) the corners of the faces."""
    faces, count = np.asarray(piece.faces).ravel(), len(piece.vertices)
    if faces.min() < 0 or faces.max() >= count:
        raise GeometryError(f"a face names vertex {faces.max()}, there are {count} (from 0).")
    corners: FloatArray = np.asarray(piece.vertices, dtype=np.float64)[faces]
    if not np.isfinite(corners).all():
        raise GeometryError("its vertices are not finite.")
    return corners


def _look(
    part: trimesh.Trimesh, uv_moves: _Moves
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8] | None]:
    """A part's corner texture coordinates (F, 3, 2), corner colours (F, 3, 3) and image, if any."""
    visual, faces = part.visual, np.asarray(part.faces)
    uv = np.zeros((len(faces), 3, 2), dtype=np.float32)
    if visual.kind == "texture":
        image, tint = _image(visual.material), getattr(visual.material, "baseColorFactor", None)
        flat = image is None or visual.uv is None
        if flat and tint is None and hasattr(visual.material, "baseColorFactor"):
            tint = np.ones(3)  # glTF's default
        elif flat and tint is None:
            tint = visual.material.main_color
        painted = part.vertex_attributes.get(_EXACT["COLOR_0"], visual.vertex_attributes.get("color"))
        if painted is None and visual.material.name == _PLAIN:
            tint = np.full(3, GREY)
        rgb = np.broadcast_to(np.ones(3) if tint is None else _unit(tint)[:3], (*faces.shape, 3))
        if painted is not None:
            rgb = rgb * _unit(painted)[:, :3][faces]
        if not flat:
            at = np.asarray(visual.uv, dtype=np.float64)[:, :2]
            if (exact := part.vertex_attributes.get(_EXACT["TEXCOORD_0"])) is not None:
                at = np.array([0.0, 1.0]) + np.array([1.0, -1.0]) * _unit(exact)
            if at.shape != (len(part.vertices), 2):
                raise GeometryError("a texture coordinate has not two numbers.")
            if (move := uv_moves.get(str(visual.material.name))) is not None:
                down = np.column_stack([at[:, 0], 1 - at[:, 1], np.ones(len(at))]) @ move.T
                at = np.column_stack([down[:, 0], 1 - down[:, 1]])
            uv = at.astype(np.float32)[faces]
        return uv, rgb.astype(np.float32), None if flat else image
    if visual.kind == "face":
        rgb = np.repeat(_unit(visual.face_colors)[:, None, :3], 3, axis=1)
        return uv, rgb.astype(np.float32), None
    if (exact := part.vertex_attributes.get(_EXACT["COLOR_0"])) is not None:
        return uv, _unit(exact)[:, :3].astype(np.float32)[faces], None
    if visual.kind == "vertex":
        return uv, _unit(visual.vertex_colors)[:, :3].astype(np.float32)[faces], None
    return uv, np.full((*faces.shape, 3), GREY, dtype=np.float32), None


def _image(material: Any) -> NDArray[np.uint8] | None:
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    return None if image is None else np.asarray(image.convert("RGB"), dtype=np.uint8)


def _unit(colour: Any) -> FloatArray:
    """Colours or coordinates in [0, 1] from floats or unsigned integers."""
    array = np.asarray(colour)
    full = np.iinfo(array.dtype).max if array.dtype.kind == "u" else 1.0
    return np.clip(array / full, 0.0, 1.0)
