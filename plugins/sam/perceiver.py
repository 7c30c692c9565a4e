"""Clusters above the table, a prompt each in every picture, one thing a cluster: the perceiver ``sam``."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Observation
from gvla2.perception.clusters import Clusters, clusters
from gvla2.perception.frames import BoolArray, Frame, Table, frames_of, raised
from gvla2.perception.fusing import Candidate, fuse, iou, objects_of
from gvla2.perception.labels import labelled
from gvla2.perception.options import labellers, vision_model
from gvla2.perception.prompting import EncodedPicture, Prompt, Segmenter, Segments
from gvla2.perception.things import numbered, over_workspace
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2_plugins.sam import SamConfig

MODELS = ("sam2", "vit_b", "vit_l", "vit_h", "mobile_sam")
LEAST = 6
"""Pixels in one picture from which a cluster is asked for there."""
LEAK = 5
"""Pixels about a cluster within which its mask is believed: depth misses edges, a mask may also run along the table."""
AGREES = 0.5
"""Share of a cluster's pixels that its mask must cover."""

log = logging.getLogger(__name__)


class SamPerceiver:
    """Objects on a table from RGB-D views; geometry proposes, the model draws the outlines.

    Raises :class:`ConfigurationError` for options that cannot be, :class:`MissingDependencyError` without weights.
    """

    def __init__(self, config: SamConfig, segmenter: Segmenter | None = None) -> None:
        if config.model not in MODELS:
            raise ConfigurationError(f"perceiver.model is '{config.model}'; it must be one of {', '.join(MODELS)}.")
        if config.min_points < 3 or not config.min_height > 0 or not 0 <= config.min_score <= 1 or config.threads < 0:
            raise ConfigurationError(
                "perceiver=sam: min_points must be at least 3, min_height above 0, min_score in [0, 1], threads >= 0."
            )
        self._config = config
        self._vision = vision_model(config.vision, "perceiver.localize") if config.localize else None
        self._labellers = labellers(config)
        self._segmenter = segmenter or _load(config)

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """The scene inside ``workspace``, objects ordered by x, then y.

        Raises :class:`PerceptionError` when no camera delivers depth, or no level plane is found. The instruction is
        used by ``localize`` alone.
        """
        config = self._config
        frames, table, notes = frames_of(observation.views, workspace)
        found = clusters(frames, [raised(f, table, workspace, config.min_height) for f in frames], config.min_points)
        candidates: list[Candidate] = []
        pictures: list[EncodedPicture] = []
        for number, frame in enumerate(frames):
            if not found.count and not config.localize:
                break  # nothing stands on the table: there is nothing to ask
            log.info("perceiver=sam: picture %d of %d ('%s')", number + 1, len(frames), frame.view.name)
            pictures.append(self._segmenter.encode(frame.view.image))
            candidates += self._asked(pictures[-1], number, frame, found)
        objects, small = objects_of(fuse(frames, candidates), frames, table, config.min_points)
        middle = 0.5 * (workspace.low + workspace.high)
        scene = Scene((), table.height_at(*middle[:2].tolist()), workspace, "sam", (*notes, *small))
        scene = _with(scene, over_workspace(objects, scene))
        if self._vision is not None:
            from gvla2.perception.localizing import localized

            scene = localized(scene, frames, pictures, table, instruction, self._vision, config.vision)
        return labelled(scene, observation, self._labellers)

    def _asked(self, picture: EncodedPicture, number: int, frame: Frame, found: Clusters) -> list[Candidate]:
        """A candidate for each cluster that is in sight."""
        clustered = found.maps[number]
        shown = [k for k in range(found.count) if (clustered == k).sum() >= LEAST]
        answers = picture.segment([prompt_for(clustered == k) for k in shown])
        candidates = []
        for k, (logits, scores) in zip(shown, zip(answers.logits, answers.scores, strict=True), strict=True):
            own = clustered == k
            others = (clustered >= 0) & ~own
            mask, score = best_mask(Segments(logits[None], scores[None]), own, others)
            if score < self._config.min_score or (mask & own).sum() < AGREES * own.sum():
                mask, score = own, self._config.min_score
            candidates.append(Candidate(number, mask, score, seed=k))
        return candidates


def prompt_for(own: BoolArray) -> Prompt:
    """A box about the pixels (H, W) and the one that lies deepest in them."""
    rows, columns = np.nonzero(own)
    depth = distance_transform_edt(np.pad(own, 1))[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(depth)), own.shape)
    box = (float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1))
    return Prompt(np.array([[column + 0.5, row + 0.5]]), np.array([True]), box)


def best_mask(answer: Segments, own: BoolArray, others: BoolArray) -> tuple[BoolArray, float]:
    """The mask of one answer (1, C, H, W) that the model and the geometry agree on best, without leaks.

    ``own`` are the pixels that asked, ``others`` those of other clusters.
    """
    around = binary_dilation(own, np.ones((3, 3), bool), iterations=LEAK) & ~others
    masks = [np.asarray(mask & around) for mask in answer.masks()[0]]
    worth = [score + iou(mask, own) for mask, score in zip(masks, answer.scores[0], strict=True)]
    best = int(np.argmax(worth))
    return masks[best], float(answer.scores[0][best])


def _with(scene: Scene, objects: Sequence[SceneObject]) -> Scene:
    return Scene(numbered(objects), scene.table_height, scene.workspace, scene.perceiver, scene.notes)


def _load(config: SamConfig) -> Segmenter:
    if config.model == "sam2":
        from gvla2_plugins.sam.onnx_model import Sam2Onnx

        return Sam2Onnx(config.weights, dict(config.sha256), config.threads)
    from gvla2_plugins.sam.kornia_model import load_sam

    return load_sam(config.model, config.weights, dict(config.sha256))
