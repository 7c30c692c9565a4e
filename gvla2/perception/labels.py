"""Labellers: one contract, and how several answers become one label.

Colour and shape always give a label ("red box"). A labeller may know better: a gallery of known objects, or a
vision-language model that reads crops. The first that is sure enough is used; none has to guess.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from gvla2.geometry.views import Observation
from gvla2.planning.scene import KnownShape, Scene, SceneObject

SURE_ENOUGH = 0.5
"""Least sureness for a name to be used."""


@dataclass(frozen=True)
class Naming:
    """A source's answer for one thing.

    ``label`` is "" for unknown; ``sureness`` in [0, 1] is the source's own estimate that the label is right, and for an
    unknown thing that the source does not know it. ``known`` is the scan and its pose, if the source has one; ``why``
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

    def names(self, things: Sequence[SceneObject], scene: Scene, observation: Observation) -> list[Naming]:
        """One answer per thing, in order. A thing that cannot be named is unknown, never an error."""
        ...


def labelled(scene: Scene, observation: Observation, labellers: Sequence[Labeller]) -> Scene:
    """The scene with the names of the first labeller that is sure of each whole thing.

    Painted regions and parts keep their labels: a lid is the lid of the named thing. A thing unknown to all keeps its
    colour and shape; the notes say so.
    """
    left = [o for o in scene.objects if o.shape != "region" and not o.parent]
    notes = list(scene.notes)
    for labeller in labellers:
        if not left:
            break
        answers = labeller.names(left, scene, observation)
        still = []
        for thing, answer in zip(left, answers, strict=True):
            if answer.label and answer.sureness >= SURE_ENOUGH:
                scene = scene.with_object(
                    replace(
                        thing,
                        label=answer.label,
                        named_by=labeller.source,
                        sureness=round(answer.sureness, 3),
                        known=answer.known,
                    )
                )
            else:
                still.append(thing)
                notes.append(f"{thing.id}: unknown to the {labeller.source}. {answer.why}".strip())
        left = still
    return replace(scene, notes=tuple(notes))
