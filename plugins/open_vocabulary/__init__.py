"""Perceivers that search for given words: ``sam3`` (text to masks) and ``detector`` (text to boxes).

Both load checkpoints through ``transformers``: SAM 3 (Meta), Grounding DINO, OWLv2.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.perception.options import NamingOptions

if TYPE_CHECKING:
    from gvla2.planning.contracts import Perceiver


@dataclass
class VocabularyConfig(NamingOptions, ComponentConfig):
    """Options of ``sam3`` and ``detector``.

    ``weights``: a folder as ``save_pretrained`` writes it (config.json, model.safetensors, the tokenizer's files).
    ``words``: what to look for; by default the objects named in the instruction: each noun phrase between its verbs and
    prepositions. ``threshold``: less certain answers are dropped. ``min_points``: fewer pixels with depth, over all
    views, are a speck.
    """

    weights: str = ""
    words: list[str] = field(default_factory=list)
    threshold: float = 0.3
    min_points: int = 14


def _build_sam3(config: VocabularyConfig) -> Perceiver:
    """SAM 3 by transformers: masks of what words name, fused over the views in 3D; needs weights."""
    from gvla2_plugins.open_vocabulary.models import load_sam3
    from gvla2_plugins.open_vocabulary.perceiver import VocabularyPerceiver

    return VocabularyPerceiver("sam3", config, load_sam3(config.weights))


def _build_detector(config: VocabularyConfig) -> Perceiver:
    """Grounding DINO or OWLv2 by transformers: boxes of what words name, cut out by depth; needs weights."""
    from gvla2_plugins.open_vocabulary.models import load_detector
    from gvla2_plugins.open_vocabulary.perceiver import VocabularyPerceiver

    return VocabularyPerceiver("detector", config, load_detector(config.weights))


@hookimpl
def gvla2_perceivers() -> list[Component[Perceiver]]:
    """The perceivers ``sam3`` and ``detector``."""
    return [
        Component("sam3", VocabularyConfig, _build_sam3),
        Component("detector", VocabularyConfig, _build_detector),
    ]
