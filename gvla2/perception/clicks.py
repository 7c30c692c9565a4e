"""Iterative localization: a vision model clicks at the target, a segmentation model draws it, until both agree.

Propose, click, segment: the picture shows outlines of the proposals and the mask so far; the model answers one click a
round. The affordance segmentation module of GeneralVLA, with its stopping rules stated. The clicked target becomes the
object that the mask shows, or one that geometry alone did not separate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageOps
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from gvla2.geometry.transform import FloatArray
from gvla2.io.foreign import png_bytes
from gvla2.language.contracts import LanguageModel, LanguageModelError
from gvla2.language.contracts import picture as picture_part
from gvla2.language.typed import ask_typed, json_in
from gvla2.perception.clusters import TOUCHING, Fused, MaskCandidate, in_sight, iou, objects_of
from gvla2.perception.frames import BoolArray, ViewFrame
from gvla2.perception.options import VisionOptions
from gvla2.perception.registration import TablePlane
from gvla2.planning.scene import Scene, SceneObject


@dataclass(frozen=True)
class Prompt:
    """A target in a picture, in pixels, the first pixel's centre at (0.5, 0.5).

    ``points`` (P, 2) on it as (u, v); ``box`` is (left, top, right, bottom) or None. At least one point or a box.
    """

    points: FloatArray
    box: tuple[float, float, float, float] | None = None


@dataclass(frozen=True)
class Segments:
    """Answers to K prompts, C masks each, from the part under a point to the whole.

    ``masks`` (K, C, H, W) bool at the picture's size; ``scores`` (K, C) is the model's estimate of each mask's IoU, in
    [0, 1].
    """

    masks: NDArray[np.bool_]
    scores: FloatArray


Segment = Callable[[list[Prompt]], Segments]
"""The masks of one encoded picture for one or more prompts."""


class Segmenter(Protocol):
    """A model that segments what it is pointed at: SAM, SAM 2, MobileSAM."""

    def encode(self, image: NDArray[np.uint8]) -> Segment:
        """Encode one picture (H, W, 3) RGB."""
        ...


BUDGET = 5
"""Maximum number of rounds."""
SETTLED = 0.98
"""Intersection over union of two rounds' masks above which they have settled."""
GOOD = 0.3
"""The least IoU that the segmentation model must estimate for a mask."""
LARGEST = 0.6
"""Share of the picture above which a mask is the background."""
SAME = 0.6
"""Share of an object's points and of the mask's above which the mask shows the object."""
TINT, OUTLINE = (255, 60, 200), (255, 255, 0)
SCHEMA = {
    "type": "object",
    "properties": {"done": {"type": "boolean"}, "x": {"type": "number"}, "y": {"type": "number"}},
    "required": ["done", "x", "y"],
    "additionalProperties": False,
}
QUESTION = """A robot is asked: "{words}"
Point at the one object that it must handle first. The picture shows what stands there with yellow outlines, and in pink
what is marked so far, with earlier clicks as dots.
Answer one JSON object: {{"done": false, "x": X, "y": Y}} for a click at X, Y (from 0 to {scale:g}, from left and
from top) on the object where it is not marked; {{"done": true, "x": 0, "y": 0}} when the mark covers all of it and
nothing else. {refused}"""


@dataclass(frozen=True)
class Located:
    """What was found: the last good ``mask`` (H, W), None if no round gave one, and its ``score`` in [0, 1].

    ``clicks`` are the accepted ones, pixels (u, v); ``refused`` counts the others.
    """

    mask: BoolArray | None
    score: float
    clicks: tuple[tuple[float, float], ...]
    refused: int
    stopped: Literal["settled", "done", "budget", "no_answer"]


def locate(
    model: LanguageModel,
    image: NDArray[np.uint8],
    segment: Segment,
    proposals: Sequence[BoolArray],
    words: str,
    options: VisionOptions,
) -> Located:
    """Ask for clicks at what ``words`` refer to in a picture (H, W, 3); ``proposals`` (H, W) are the masks of objects.

    A model that cannot be asked, or answers nonsense, ends it; the last good mask is kept.
    """
    mask: BoolArray | None = None
    score, clicks, why, refused = 0.0, list[tuple[float, float]](), "", 0

    def located(stopped: Literal["settled", "done", "budget", "no_answer"]) -> Located:
        return Located(mask, score, tuple(clicks), refused, stopped)

    for _ in range(BUDGET):
        shown = overlay(image, proposals, mask, clicks, options.longest)
        try:
            answer = _asked(model, shown, words, why, options)
        except LanguageModelError:
            return located("no_answer")
        if answer is None and mask is not None:
            return located("done")
        if answer is None:
            why = "You said done, but nothing is marked yet: click at the object."
            continue
        click = (answer[0] * image.shape[1], answer[1] * image.shape[0])
        why, fresh = "Your last click lies outside the picture.", None
        if 0 <= click[0] < image.shape[1] and 0 <= click[1] < image.shape[0]:
            why, fresh = "Your last click gave no mask of an object.", _segmented(segment, [*clicks, click])
        if fresh is None:
            refused += 1
            continue
        clicks.append(click)
        before, (mask, score), why = mask, fresh, ""
        if before is not None and iou(before, mask) > SETTLED:
            return located("settled")
    return located("budget")


def _asked(
    model: LanguageModel, png: bytes, words: str, refused: str, options: VisionOptions
) -> tuple[float, float] | None:
    """A click in shares of the picture's sides, None for "done"."""

    def parse(text: str) -> tuple[float, float] | None:
        found = json_in(text)
        if not isinstance(found, dict):
            raise ValueError("Answer one JSON object.")
        if found.get("done") is True:
            return None
        x, y = found.get("x"), found.get("y")
        if not all(isinstance(v, int | float) and np.isfinite(v) for v in (x, y)):
            raise ValueError("x and y must be numbers.")
        return float(str(x)) / options.scale, float(str(y)) / options.scale

    text = QUESTION.format(words=" ".join(words.split())[:500], scale=options.scale, refused=refused)
    messages = [{"role": "user", "content": [picture_part(png), {"type": "text", "text": text}]}]
    return ask_typed(model, messages, parse, purpose="localize", schema=SCHEMA, tries=2).answer


def _segmented(segment: Segment, clicks: Sequence[tuple[float, float]]) -> tuple[BoolArray, float] | None:
    """The best mask that holds most clicks, and its score; None if all are empty, unsure or the background."""
    answer = segment([Prompt(np.array(clicks))])
    columns, rows = np.array(clicks).astype(int).T
    found = [
        (score + float(mask[rows, columns].mean()), np.asarray(mask), float(score))
        for mask, score in zip(answer.masks[0], answer.scores[0], strict=True)
        if mask.any() and mask.mean() < LARGEST and score >= GOOD
    ]
    return max(found, key=lambda each: each[0])[1:] if found else None


def overlay(
    image: NDArray[np.uint8],
    proposals: Sequence[BoolArray],
    mask: BoolArray | None,
    clicks: Sequence[tuple[float, float]],
    longest: int,
) -> bytes:
    """The picture as PNG with outlines of the proposals, the mask so far tinted, and the clicks as dots."""
    shown = image.astype(np.float64)
    if mask is not None:
        shown[mask] = 0.6 * shown[mask] + 0.4 * np.array(TINT)
    for proposal in proposals:
        shown[binary_dilation(proposal) & ~proposal] = OUTLINE
    factor = longest / max(image.shape[:2])
    drawn = ImageOps.scale(Image.fromarray(np.rint(shown).astype(np.uint8)), factor)
    pen = ImageDraw.Draw(drawn)
    for u, v in clicks:
        pen.ellipse([u * factor - 4, v * factor - 4, u * factor + 4, v * factor + 4], fill=(0, 255, 0))
    return png_bytes(drawn)


def localized(
    scene: Scene,
    frames: Sequence[ViewFrame],
    segmenter: Segmenter,
    table: TablePlane,
    instruction: str,
    model: LanguageModel,
    options: VisionOptions,
) -> Scene:
    """The scene with a note on the instruction's target, from clicks in the picture that shows the most.

    A target that geometry did not separate becomes an object of its own, with the object that it is part of as parent.
    """
    if not scene.objects or not instruction.strip():
        return scene
    shown = [[_shown(frame, obj) for obj in scene.objects] for frame in frames]
    view = int(np.argmax([sum(int(mask.sum()) for mask in masks) for masks in shown]))
    frame = frames[view]
    found = locate(
        model, frame.view.image, segmenter.encode(frame.view.image), shown[view], instruction, options
    )

    def noted(note: str, *objects: SceneObject) -> Scene:
        text = f"{note}: {len(found.clicks)} clicks, {found.refused} refused, {found.stopped}."
        return replace(scene, objects=(*scene.objects, *objects), notes=(*scene.notes, text))

    if found.mask is None:
        return noted("Nothing was localized")
    cloud = frame.points[found.mask & frame.known & (frame.height > 0)]
    shares = [_shares(frame, cloud, obj) for obj in scene.objects]
    best = max(range(len(shares)), key=lambda k: shares[k][0] * shares[k][1])
    if min(shares[best]) >= SAME:
        return noted(f"{scene.objects[best].id} is the target")
    made, _ = objects_of([Fused((MaskCandidate(view, found.mask, found.score),))], frames, table, 3)
    if not made:
        return noted("The localized target has no depth")
    parent = scene.objects[best].id if shares[best][0] * shares[best][1] > 0.1 else ""
    new = f"o{len(scene.objects) + 1}"
    return noted(
        f"{new} is the target, a part that geometry did not separate",
        replace(made[0], id=new, parent=parent),
    )


def _shares(frame: ViewFrame, cloud: FloatArray, obj: SceneObject) -> tuple[float, float]:
    """Share of the mask's points (N, 3) that lie on an object, and of the object's points in sight on the mask."""
    visible = obj.points[in_sight(frame, obj.points)[0]]
    if not len(cloud) or not len(visible):
        return 0.0, 0.0

    def share(points: FloatArray, of: FloatArray) -> float:
        return float(np.isfinite(cKDTree(points).query(of, distance_upper_bound=TOUCHING)[0]).mean())

    return share(obj.points, cloud), share(cloud, visible)


def _shown(frame: ViewFrame, obj: SceneObject) -> BoolArray:
    """(H, W) the pixels of an object's points in a picture."""
    mask = np.zeros(frame.height.shape, dtype=bool)
    _, rows, columns = in_sight(frame, obj.points)
    mask[rows, columns] = True
    return mask
