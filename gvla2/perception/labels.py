"""Who names things: one contract, and how several answers become one label.

Colour and shape always give a label ("red box"). A labeller may know better: a gallery of known objects, or a
vision-language model that reads crops. The first that is sure enough is believed; none is made to guess.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from gvla2.geometry.views import Observation
from gvla2.planning.scene import KnownShape, Scene, SceneObject

SURE_ENOUGH = 0.5
"""From this sureness on a name is used."""


@dataclass(frozen=True)
class Naming:
    """What a source makes of one thing.

    ``label`` is "" for unknown; ``sureness`` in [0, 1] is the source's own estimate that the label is right, and for
    an unknown thing that it is none of those that the source knows. ``known`` is the scan and its pose, where the
    source has one; ``why`` is a sentence for the scene's notes.
    """

    label: str
    sureness: float
    known: KnownShape | None = None
    why: str = ""


class Labeller(Protocol):
    """A source of names."""

    @property
    def source(self) -> str:
        """What the scene says of where a name comes from: "gallery", "reader"."""
        ...

    def names(self, things: Sequence[SceneObject], scene: Scene, observation: Observation) -> list[Naming]:
        """One answer a thing, in order. What cannot be named is unknown, never an error of the run."""
        ...


def labelled(scene: Scene, observation: Observation, labellers: Sequence[Labeller]) -> Scene:
    """The scene with the names of the first labeller that is sure of each whole thing.

    Painted regions and parts keep their labels: a lid is the lid of what was named. A thing that none knows keeps its
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
