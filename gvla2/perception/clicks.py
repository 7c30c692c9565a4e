"""Iterative localization: a vision model clicks at the target, a segmentation model draws it, until both agree.

Propose, click, segment: the picture is shown with outlines of the proposals and the mask so far; the model answers one
click per round. The affordance segmentation module of GeneralVLA, with its stopping rules stated. The clicked target
becomes the object that the mask shows, or one that geometry alone did not separate.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt
from scipy.spatial import cKDTree

from gvla2.geometry.transform import FloatArray
from gvla2.language.contracts import LanguageModel, LanguageModelError
from gvla2.language.contracts import picture as picture_part
from gvla2.language.typed import ask_typed, json_in
from gvla2.perception.clusters import TOUCHING, Fused, MaskCandidate, iou, objects_of
from gvla2.perception.frames import BoolArray, TablePlane, ViewFrame
from gvla2.perception.options import VisionOptions
from gvla2.planning.scene import Scene, SceneObject


@dataclass(frozen=True)
class Prompt:
    """A target in a picture, in pixels, the first pixel's centre at (0.5, 0.5).

    ``points`` (P, 2) as (u, v); ``positive`` (P,) whether each is on the object or beside it; ``box`` is (left, top,
    right, bottom) or None. At least one point or a box.
    """

    points: FloatArray
    positive: NDArray[np.bool_]
    box: tuple[float, float, float, float] | None = None

    @classmethod
    def click(cls, u: float, v: float) -> Prompt:
        """One point on the object."""
        return cls(np.array([[u, v]]), np.array([True]))


@dataclass(frozen=True)
class Segments:
    """Answers to K prompts, C masks each, from the part under a point to the whole.

    ``logits`` (K, C, H, W) float32 at the picture's size, a pixel is inside where it is above 0; ``scores`` (K, C) is
    the model's estimate of each mask's IoU, in [0, 1].
    """

    logits: NDArray[np.float32]
    scores: FloatArray

    def masks(self) -> NDArray[np.bool_]:
        """(K, C, H, W)."""
        return np.asarray(self.logits > 0)


class EncodedPicture(Protocol):
    """An encoded picture."""

    def segment(self, prompts: list[Prompt]) -> Segments:
        """The masks for the prompts; K = 0 is allowed."""
        ...


class Segmenter(Protocol):
    """A model that segments what it is pointed at: SAM, SAM 2, MobileSAM."""

    def encode(self, image: NDArray[np.uint8]) -> EncodedPicture:
        """Encode one picture (H, W, 3) RGB."""
        ...


BUDGET = 5
"""Rounds at most."""
SETTLED = 0.98
"""Intersection over union of two rounds' masks above which they have settled."""
FAR = 24.0
"""Pixels from the nearest object or mask beyond which a click is refused."""
GOOD = 0.3
"""The least IoU that the segmentation model must estimate for a mask."""
LARGEST = 0.6
"""Share of the picture above which a mask is the background."""
TINT, OUTLINE = (255, 60, 200), (255, 255, 0)
SCHEMA = {
    "type": "object",
    "properties": {
        "done": {"type": "boolean"},
        "x": {"type": "number"},
        "y": {"type": "number"},
        "on": {"type": "boolean"},
    },
    "required": ["done", "x", "y", "on"],
    "additionalProperties": False,
}
QUESTION = """A robot is told: "{words}"
Point at the one object that it must handle first. The picture shows what stands there with yellow outlines{marked}.
Answer one JSON object: {{"done": false, "x": X, "y": Y, "on": true}} for a click at X, Y (from 0 to {scale:g}, from the
left and from the top) on the object{missing}; {{"done": false, "x": X, "y": Y, "on": false}} for a click at what
is marked and does not belong to it; {{"done": true, "x": 0, "y": 0, "on": true}} when the mark covers all of it and
nothing else.{refused}"""


@dataclass(frozen=True)
class Click:
    """One answer: pixels (u, v) of the picture, whether on the object, why it was refused ("" if taken)."""

    u: float
    v: float
    on: bool
    refused: str = ""


@dataclass(frozen=True)
class Located:
    """What was found: the last good ``mask`` (H, W), None if no round gave one; ``score`` of that mask.

    ``stopped`` is one of ``settled``, ``done``, ``budget``, ``no_answer``.
    """

    mask: BoolArray | None
    score: float
    clicks: tuple[Click, ...]
    stopped: str
    masks: tuple[BoolArray, ...] = field(default=(), repr=False)


def locate(
    model: LanguageModel,
    image: NDArray[np.uint8],
    encoded: EncodedPicture,
    proposals: Sequence[BoolArray],
    words: str,
    *,
    scale: float = 1000.0,
    longest: int = 1024,
    budget: int = BUDGET,
) -> Located:
    """Ask for clicks at what ``words`` refer to in a picture (H, W, 3); ``proposals`` (H, W) are the masks of objects.

    A model that is unavailable or useless ends it: the last good mask is kept.
    """
    mask: BoolArray | None = None
    score, refused = 0.0, ""
    clicks: list[Click] = []
    masks: list[BoolArray] = []
    for _ in range(budget):
        png = overlay(image, proposals, mask, [c for c in clicks if not c.refused], longest)
        try:
            answer = _asked(model, png, words, mask is not None, refused, scale)
        except LanguageModelError:
            return Located(mask, score, tuple(clicks), "no_answer", tuple(masks))
        if answer is None:
            if mask is not None:
                return Located(mask, score, tuple(clicks), "done", tuple(masks))
            refused = " You said done, but nothing is marked yet: click at the object."
            continue
        x, y, on = answer
        click = Click(x * image.shape[1] / scale, y * image.shape[0] / scale, on)
        refused = _insane(click, image.shape[:2], proposals, mask)
        if refused:
            clicks.append(Click(click.u, click.v, on, refused))
            refused = f" Your last click was refused: {refused}"
            continue
        taken = [*(c for c in clicks if not c.refused), click]
        fresh, sure = _segmented(encoded, taken, proposals)
        if fresh is None:
            clicks.append(Click(click.u, click.v, on, "The mask that it gave was no object."))
            refused = " Your last click gave no mask of an object: click elsewhere on it."
            continue
        clicks.append(click)
        masks.append(fresh)
        before, mask, score = mask, fresh, sure
        if before is not None and iou(before, fresh) > SETTLED:
            return Located(mask, score, tuple(clicks), "settled", tuple(masks))
    return Located(mask, score, tuple(clicks), "budget", tuple(masks))


def _asked(
    model: LanguageModel, png: bytes, words: str, marked: bool, refused: str, scale: float
) -> tuple[float, float, bool] | None:
    """A click in the model's coordinates, None for "done"."""
    text = QUESTION.format(
        words=" ".join(words.split())[:500],
        marked=" and what is marked so far in pink, earlier clicks as dots" if marked else "",
        missing=" where the mark misses some of it" if marked else "",
        scale=scale,
        refused=refused,
    )
    messages = [{"role": "user", "content": [picture_part(png), {"type": "text", "text": text}]}]
    return ask_typed(model, messages, _parse, purpose="localize", schema=SCHEMA, tries=2).answer


def _parse(text: str) -> tuple[float, float, bool] | None:
    found = json_in(text)
    if not isinstance(found, dict):
        raise ValueError("Answer one JSON object.")
    if found.get("done") is True:
        return None
    x, y, on = found.get("x"), found.get("y"), found.get("on", True)
    if not all(isinstance(v, int | float) and not isinstance(v, bool) and np.isfinite(v) for v in (x, y)):
        raise ValueError("x and y must be numbers.")
    if not isinstance(on, bool):
        raise ValueError("on must be true or false.")
    return float(str(x)), float(str(y)), on


def _insane(
    click: Click, size: tuple[int, int], proposals: Sequence[BoolArray], mask: BoolArray | None
) -> str:
    """Why a click is implausible; "" if it is not."""
    if not (0 <= click.u < size[1] and 0 <= click.v < size[0]):
        return "it lies outside the picture."
    there = np.zeros(size, dtype=bool)
    for shown in (*proposals, *(() if mask is None else (mask,))):
        there |= shown
    if not there.any():
        return ""
    gap = float(distance_transform_edt(~there)[int(click.v), int(click.u)])
    return f"nothing stands within {FAR:.0f} pixels of it." if gap > FAR else ""


def _segmented(
    encoded: EncodedPicture, clicks: Sequence[Click], proposals: Sequence[BoolArray]
) -> tuple[BoolArray | None, float]:
    """The mask for all accepted clicks; None if it is empty, unsure or the background.

    The box of the proposal under the clicks helps: one point on a printed box could mean just the print.
    """
    points = np.array([[c.u, c.v] for c in clicks])
    positive = np.array([c.on for c in clicks])
    if not positive.any():
        return None, 0.0
    own = [p for p in proposals if any(c.on and p[int(c.v), int(c.u)] for c in clicks)]
    box = None
    if own:
        rows, columns = np.nonzero(np.any(own, axis=0))
        box = (float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1))
    answer = encoded.segment([Prompt(points, positive, box)])
    best, worth = None, -np.inf
    for mask, score in zip(answer.masks()[0], answer.scores[0], strict=True):
        kept = np.mean([bool(mask[int(c.v), int(c.u)]) == c.on for c in clicks])
        agreed = iou(mask, np.any(own, axis=0)) if own else 0.0
        if mask.any() and mask.mean() < LARGEST and score >= GOOD and score + kept + agreed > worth:
            best, worth, sure = np.asarray(mask), score + kept + agreed, float(score)
    return (best, sure) if best is not None else (None, 0.0)


def overlay(
    image: NDArray[np.uint8], proposals: Sequence[BoolArray], mask: BoolArray | None, clicks: Sequence[Click],
    longest: int,
) -> bytes:  # fmt: skip
    """The picture as PNG with outlines of the proposals, the mask so far tinted, and the clicks as dots."""
    shown = image.astype(np.float64)
    if mask is not None:
        shown[mask] = 0.6 * shown[mask] + 0.4 * np.array(TINT)
    factor = max(1, min(longest // max(image.shape[:2]), 4))
    grown = np.kron(np.rint(shown).astype(np.uint8), np.ones((factor, factor, 1), dtype=np.uint8))
    for proposal in proposals:
        large = np.kron(proposal, np.ones((factor, factor), dtype=bool))
        grown[binary_dilation(large) & ~binary_erosion(large)] = OUTLINE
    drawn = Image.fromarray(grown)
    pen = ImageDraw.Draw(drawn)
    for click in clicks:
        u, v = click.u * factor, click.v * factor
        pen.ellipse([u - 4, v - 4, u + 4, v + 4], fill=(0, 255, 0) if click.on else (255, 0, 0))
    drawn.thumbnail((longest, longest))
    stream = io.BytesIO()
    drawn.save(stream, "PNG")
    return stream.getvalue()


SAME = 0.6
"""Share of an object's points and of the mask's above which the mask shows the object."""


def localized(
    scene: Scene,
    frames: Sequence[ViewFrame],
    segmenter: Segmenter,
    table: TablePlane,
    instruction: str,
    model: LanguageModel,
    options: VisionOptions,
) -> Scene:
    """The scene with a note on the instruction's target, from clicks in the picture that shows the most."""
    if not scene.objects or not instruction.strip():
        return scene
    shown = [[_shown(frame, obj) for obj in scene.objects] for frame in frames]
    view = int(np.argmax([sum(int(mask.sum()) for mask in masks) for masks in shown]))
    found = locate(
        model, frames[view].view.image, segmenter.encode(frames[view].view.image), shown[view], instruction,
        scale=options.scale, longest=options.longest,
    )  # fmt: skip
    if found.mask is None:
        return replace(scene, notes=(*scene.notes, f"Nothing was localized: {_story(found)}."))
    return _merged(scene, frames, table, found, view)


def _merged(scene: Scene, frames: Sequence[ViewFrame], table: TablePlane, found: Located, view: int) -> Scene:
    assert found.mask is not None
    own = found.mask & frames[view].known
    cloud = frames[view].points[own & (frames[view].height > 0)]
    best, worth, of_mask = None, 0.0, 0.0
    for obj in scene.objects:
        if not len(cloud) or not len(obj.points):
            continue
        share = float(np.isfinite(cKDTree(obj.points).query(cloud, distance_upper_bound=TOUCHING)[0]).mean())
        in_sight = obj.points[_in_sight(frames[view], obj.points)]
        back = (
            float(np.isfinite(cKDTree(cloud).query(in_sight, distance_upper_bound=TOUCHING)[0]).mean())
            if len(in_sight)
            else 0.0
        )
        if share * back > worth:
            best, worth, of_mask = obj, share * back, min(share, back)
    if best is not None and of_mask >= SAME:
        return replace(scene, notes=(*scene.notes, f"{best.id} is the target: {_story(found)}."))
    made, _ = objects_of([Fused((MaskCandidate(view, found.mask, found.score),))], frames, table, 3)
    if not made:
        return replace(scene, notes=(*scene.notes, f"The localized target has no depth: {_story(found)}."))
    new = f"o{len(scene.objects) + 1}"
    parent = best.id if best is not None and worth > 0.1 else ""
    note = f"{new} is the target, a part that geometry did not separate: {_story(found)}."
    obj = replace(made[0], id=new, parent=parent)
    return replace(scene, objects=(*scene.objects, obj), notes=(*scene.notes, note))


def _story(found: Located) -> str:
    refused = sum(bool(click.refused) for click in found.clicks)
    return f"{len(found.clicks)} clicks, {refused} refused, {found.stopped}"


def _shown(frame: ViewFrame, obj: SceneObject) -> BoolArray:
    """(H, W) the pixels of an object's points in a picture."""
    mask = np.zeros(frame.height.shape, dtype=bool)
    camera = frame.view.camera
    uv, _ = camera.project(obj.points[_in_sight(frame, obj.points)])
    columns, rows = np.floor(uv).astype(int).T
    mask[rows, columns] = True
    return mask


def _in_sight(frame: ViewFrame, points: np.ndarray) -> BoolArray:
    uv, z = frame.view.camera.project(points)
    inside = frame.view.camera.inside(uv)
    near = np.zeros(len(points), dtype=bool)
    columns, rows = np.floor(uv[inside]).astype(int).T
    assert frame.view.depth is not None
    with np.errstate(invalid="ignore"):
        near[inside] = np.abs(frame.view.depth[rows, columns] - z[inside]) < 1.5 * TOUCHING
    return near
