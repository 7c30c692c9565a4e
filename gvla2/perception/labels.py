"""Labellers: one contract, how several answers become one label, and a vision-language model that reads crops."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.geometry.views import Observation, View
from gvla2.io.foreign import png_bytes
from gvla2.language.contracts import LanguageModel, LanguageModelError, picture
from gvla2.language.typed import ask_typed, json_in
from gvla2.perception.objects import object_of
from gvla2.planning.scene import PRINTED, KnownShape, Scene, SceneObject

SURE_ENOUGH = 0.5
"""Least sureness for a name to be used."""


@dataclass(frozen=True)
class Naming:
    """A source's answer for one object.

    ``label`` is "" for unknown; ``sureness`` in [0, 1] is the source's own estimate that the label is right, and for an
    unknown object that the source does not know it. ``known`` is the scan and its pose, if the source has one; ``why``
    is a sentence for the scene's notes.
    """

    label: str
    sureness: float
    known: KnownShape | None = None
    why: str = ""


class Labeller(Protocol):
    """A source of names."""

    @property
    def source(self) -> str:
        """The name's origin as recorded in the scene: "gallery", "reader"."""
        ...

    def names(self, objects: Sequence[SceneObject], scene: Scene, observation: Observation) -> list[Naming]:
        """One answer per object, in order. An object that cannot be named is unknown, never an error."""
        ...


def labelled(scene: Scene, observation: Observation, labellers: Sequence[Labeller]) -> Scene:
    """The scene with the names of the first labeller that is sure of each whole object.

    Painted regions and parts keep their labels: a lid is the lid of the named object. An object unknown to all keeps
    its colour and shape; the notes say so.
    """
    left = [o for o in scene.objects if o.shape != "region" and not o.parent and not o.named_by]
    notes = list(scene.notes)
    for labeller in labellers:
        if not left:
            break
        answers = labeller.names(left, scene, observation)
        still = []
        for obj, answer in zip(left, answers, strict=True):
            if answer.label and answer.sureness >= SURE_ENOUGH:
                scene = scene.with_object(
                    replace(
                        obj,
                        label=answer.label,
                        named_by=labeller.source,
                        sureness=round(answer.sureness, 3),
                        known=answer.known,
                    )
                )
            else:
                still.append(obj)
                notes.append(f"{obj.id}: unknown to the {labeller.source}. {answer.why}".strip())
        left = still
    return _joined(replace(scene, notes=tuple(notes)))


def _joined(scene: Scene) -> Scene:
    """The scene with pieces of one package, which bear the same words one above the other, as one object."""
    read = {o.id: o for o in scene.objects if o.named_by == PRINTED}
    for small in sorted(read.values(), key=lambda o: float(np.prod(o.extents))):
        *words, _ = read.pop(small.id).label.split()
        for whole in read.values():
            *others, _ = whole.label.split()
            if {*words} & {*others} and whole.covers(small.centre):
                points = np.concatenate([whole.points, small.points])
                colours = np.repeat([whole.rgb], len(points), axis=0)
                shape = object_of(points, colours, scene.table_height, whole.confidence, whole.id)
                noun = shape.label.split()[-1]
                label = " ".join(dict.fromkeys([*others, *words, noun]))
                sure = max(whole.sureness, small.sureness)
                read[whole.id] = replace(shape, label=label, named_by=PRINTED, sureness=sure)
                kept = (o for o in scene.objects if o.id != small.id)
                moved = (replace(o, parent=whole.id) if o.parent == small.id else o for o in kept)
                scene = replace(scene, objects=tuple(moved)).with_object(read[whole.id])
                break
    return scene


CROPS = 2
"""Pictures shown of one object: those with most of it."""
MARGIN = 0.35
"""Margin as a share of an object's size, so that the surroundings give its scale."""
LONGEST_NAME = 40
SCHEMA = {
    "type": "object",
    "properties": {"name": {"type": "string"}, "sure": {"type": "number"}},
    "required": ["name", "sure"],
    "additionalProperties": False,
}
QUESTION = (
    "What is the object in the middle of these pictures? It stands on a table and measures {size} mm. Answer one JSON "
    'object: {{"name": "two or three words as people say them", "sure": S}}, S from 0 (a guess) to 1 (certain). Say '
    '{{"name": "unknown", "sure": 0}} rather than guess.'
)


class CropReader:
    """A :class:`~gvla2.perception.labels.Labeller` that shows crops of each object to a model."""

    source = "reader"

    def __init__(self, model: LanguageModel, longest: int) -> None:
        self._model, self._longest = model, longest

    def names(self, objects: Sequence[SceneObject], scene: Scene, observation: Observation) -> list[Naming]:
        """One answer per object; unknown if the model cannot be asked or says so."""
        return [self._read(obj, observation) for obj in objects]

    def _read(self, obj: SceneObject, observation: Observation) -> Naming:
        crops = sorted((crop_of(view, obj, MARGIN) for view in observation.views), key=lambda c: -c[2])
        shown = [png_bytes(_enlarged(crop, self._longest)) for _, crop, pixels in crops[:CROPS] if pixels]
        if not shown:
            return Naming("", 0.0, why="No picture shows it.")
        size = " x ".join(f"{1e3 * side:.0f}" for side in obj.extents)
        content = [*(picture(png) for png in shown), {"type": "text", "text": QUESTION.format(size=size)}]
        try:
            name, sure = ask_typed(
                self._model,
                [{"role": "user", "content": content}],
                _parse,
                purpose="name",
                schema=SCHEMA,
                tries=2,
            ).answer
        except LanguageModelError as error:
            return Naming("", 0.0, why=f"The model could not be asked: {error}")
        return Naming(name, sure) if name else Naming("", 1.0 - sure, why="The model does not know it.")


def crop_of(view: View, obj: SceneObject, margin: float) -> tuple[NDArray[np.int_], NDArray[np.uint8], int]:
    """The part of a picture around an object, with a ``margin`` as a share of its longer side: its upper left corner
    (2,) as x and y, its image (H, W, 3), empty if it shows less than three of the object's points, and how many pixels
    show these.
    """
    uv, _ = view.camera.project(obj.points)
    inside = uv[view.camera.inside(uv)]
    if len(inside) < 3:
        return np.zeros(2, int), view.image[:0, :0], 0
    low, high = inside.min(axis=0), inside.max(axis=0)
    room = max(1.0, margin * float((high - low).max()))
    left, top = corner = np.floor(np.maximum(low - room, 0)).astype(int)
    right, bottom = np.ceil(high + room).astype(int)
    return corner, view.image[top:bottom, left:right], len(np.unique(np.floor(inside), axis=0))


def _enlarged(crop: np.ndarray, longest: int) -> Image.Image:
    factor = max(1, min(longest, 448) // max(crop.shape[:2]))
    image = Image.fromarray(np.ascontiguousarray(crop))
    grown = image.resize((image.width * factor, image.height * factor), Image.Resampling.BICUBIC)
    grown.thumbnail((longest, longest))
    return grown


def _parse(text: str) -> tuple[str, float]:
    """A name of plain letters, "" for unknown: one model's output must not prompt the next."""
    found = json_in(text)
    if not isinstance(found, dict) or not isinstance(found.get("name"), str):
        raise ValueError('Answer one JSON object with "name" and "sure".')
    sure = found.get("sure")
    if isinstance(sure, bool) or not isinstance(sure, int | float) or not 0 <= sure <= 1:
        raise ValueError("sure must be a number from 0 to 1.")
    name = " ".join(re.findall(r"[a-z0-9]+", found["name"].casefold()))[:LONGEST_NAME].strip()
    return ("" if name in ("", "unknown", "object") else name), float(sure)
