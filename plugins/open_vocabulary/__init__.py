"""``perceiver=sam3``: searches pictures for given words with SAM 3 (Meta), loaded through ``transformers``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.perception.options import NamingOptions

if TYPE_CHECKING:
    from gvla2.planning.contracts import Perceiver


@dataclass
class VocabularyConfig(NamingOptions, ComponentConfig):
    """Options of ``sam3``.

    ``weights``: a folder as ``save_pretrained`` writes it (config.json, model.safetensors, the tokenizer's files).
    ``words``: what to look for; by default the objects named in the instruction: each noun phrase between its verbs and
    prepositions. ``threshold``: less certain answers are dropped. ``min_points``: fewer pixels with depth, over all
    views, are a speck.
    """

    weights: str = ""
    words: list[str] = field(default_factory=list)
    threshold: float = 0.3
    min_points: int = 14


def _build(config: VocabularyConfig) -> Perceiver:
    """SAM 3 by transformers: masks of what words name, fused over the views in 3D; needs weights."""
    from gvla2_plugins.open_vocabulary.perceiver import VocabularyPerceiver, load_sam3

    return VocabularyPerceiver(config, load_sam3(config.weights))


@hookimpl
def gvla2_perceivers() -> list[Component[Perceiver]]:
    """The perceiver ``sam3``."""
    return [Component("sam3", VocabularyConfig, _build)]
