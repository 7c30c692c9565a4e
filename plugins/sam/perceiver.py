"""The perceiver ``sam``: geometry proposes clusters, a promptable model draws their masks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Observation
from gvla2.perception.clicks import Prompt, Segmenter, Segments, localized
from gvla2.perception.clusters import IntArray, MaskCandidate, clusters, fuse, iou, objects_of
from gvla2.perception.frames import BoolArray, ViewFrame, frames_of, raised
from gvla2.perception.labels import labelled
from gvla2.perception.objects import numbered, over_workspace
from gvla2.perception.options import labellers, vision_model
from gvla2.planning.scene import Box, Scene
from gvla2_plugins.sam import SamConfig
from gvla2_plugins.sam.models import Sam2Onnx

LEAST = 6
"""Pixels in one picture from which a cluster is asked for there."""
LEAK = 5
"""Pixels about a cluster within which its mask is believed: depth misses edges, a mask may also run along the table."""
AGREES = 0.5
"""Share of a cluster's pixels that its mask must cover."""
COVERED = 0.75
"""Share of a cluster's pixels in the mask of a larger one, over all pictures, from which it is a part of that."""


class SamPerceiver:
    """Objects on a table from RGB-D views; geometry proposes, the model draws the outlines.

    Raises :class:`ConfigurationError` for options that cannot be, :class:`MissingDependencyError` without weights.
    """

    def __init__(self, config: SamConfig, segmenter: Segmenter | None = None) -> None:
        if config.min_points < 3 or not config.min_height > 0 or not 0 <= config.min_score <= 1:
            raise ConfigurationError(
                "perceiver=sam: min_points must be at least 3, min_height above 0, min_score in [0, 1]."
            )
        self._config = config
        self._vision = vision_model(config.vision, "perceiver.localize") if config.localize else None
        self._labellers = labellers(config)
        self._segmenter = segmenter or Sam2Onnx(config.weights)

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """The scene inside ``workspace``, objects ordered by x, then y.

        Raises :class:`PerceptionError` when no camera delivers depth, or no level plane is found. The instruction is
        used by ``localize`` alone.
        """
        config = self._config
        frames, table, notes = frames_of(observation.views, workspace)
        masks = [raised(frame, table, workspace, config.min_height) for frame in frames]
        found = clusters(frames, masks, config.min_points)
        answers = [self._answers(frame, image) for frame, image in zip(frames, found, strict=True)]
        whole = wholes(found, answers)
        candidates = [
            each
            for view, (image, given) in enumerate(zip(found, answers, strict=True))
            for each in self._drawn(view, image, whole, given)
        ]
        placed, small = objects_of(fuse(frames, candidates), frames, table, config.min_points)
        objects = numbered(over_workspace(placed, workspace))
        scene = Scene(objects, table.height_over(workspace), workspace, "sam", (*notes, *small))
        if self._vision is not None:
            scene = localized(scene, frames, self._segmenter, table, instruction, self._vision, config.vision)
        return labelled(scene, observation, self._labellers)

    def _answers(self, frame: ViewFrame, clustered: IntArray) -> dict[int, Segments]:
        """The answer for each cluster that shows enough of itself in a picture to be asked for there."""
        shown, counts = np.unique(clustered[clustered >= 0], return_counts=True)
        asked = shown[counts >= LEAST].tolist()
        if not asked:
            return {}
        given = self._segmenter.encode(frame.view.image)([prompt_for(clustered == k) for k in asked])
        return {k: Segments(given.masks[i : i + 1], given.scores[i : i + 1]) for i, k in enumerate(asked)}

    def _drawn(
        self, view: int, clustered: IntArray, whole: Sequence[int], answers: Mapping[int, Segments]
    ) -> list[MaskCandidate]:
        """A candidate for each object that is in sight in one picture, from the answers of its clusters."""
        groups = np.where(clustered >= 0, np.asarray([*whole, -1])[clustered], -1)
        drawn: dict[int, tuple[BoolArray, float]] = {}
        for k, answer in answers.items():
            own, part = groups == whole[k], clustered == k
            mask, score = best_mask(answer, own, (groups >= 0) & ~own)
            if score < self._config.min_score or (mask & part).sum() < AGREES * part.sum():
                mask, score = part, self._config.min_score
            before = drawn.get(whole[k], (np.zeros_like(mask), 0.0))
            drawn[whole[k]] = (before[0] | mask, max(before[1], score))
        return [MaskCandidate(view, mask, score, seed=k) for k, (mask, score) in drawn.items()]


def wholes(found: Sequence[IntArray], answers: Sequence[Mapping[int, Segments]]) -> list[int]:
    """For each cluster the one that it belongs to, mostly itself.

    Depth tears apart what thin struts hold together: where the masks of a larger cluster cover a smaller one, in the
    pictures that show both, the two are one object.
    """
    whole = list(range(1 + max(int(image.max()) for image in found)))
    for small in range(len(whole)):
        for large in range(small):
            covered = []
            for clustered, given in zip(found, answers, strict=True):
                part = clustered == small
                if large in given and part.any():
                    own = clustered == large
                    mask, _ = best_mask(given[large], own | part, np.zeros_like(own))
                    covered.append(float((mask & part).sum() / part.sum()))
            if covered and np.mean(covered) >= COVERED:
                whole[small] = whole[large]
                break
    return whole


def prompt_for(own: BoolArray) -> Prompt:
    """A box about the pixels (H, W) and the one that lies deepest in them."""
    rows, columns = np.nonzero(own)
    depth = distance_transform_edt(np.pad(own, 1))[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(depth)), own.shape)
    box = (float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1))
    return Prompt(np.array([[column + 0.5, row + 0.5]]), box)


def best_mask(answer: Segments, own: BoolArray, others: BoolArray) -> tuple[BoolArray, float]:
    """The mask of one answer (1, C, H, W) that the model and the geometry agree on best, without leaks.

    ``own`` are the pixels that asked, ``others`` those of other clusters.
    """
    around = binary_dilation(own, np.ones((3, 3), bool), iterations=LEAK) & ~others
    masks = [np.asarray(mask & around) for mask in answer.masks[0]]
    worth = [score + iou(mask, own) for mask, score in zip(masks, answer.scores[0], strict=True)]
    best = int(np.argmax(worth))
    return masks[best], float(answer.scores[0][best])
