"""Whether what a model wrote about an episode rests on it: on named evidence, about the task's own objects and acts.

A model that writes lessons has read the transcript, and with it whatever a tool returned. What it passes on from there
is trusted no more than the tool.
"""

from __future__ import annotations

import re

from gvla2.memory.contracts import Lesson, MemoryEpisode
from gvla2.memory.curation.transcripts import acts_of
from gvla2.memory.indexing.terms import terms

_WORD = re.compile(r"\w+")
SHORTEST = 8
"""Characters that a passage of evidence has at least."""
ABOUT = 1 / 3
"""Share of a lesson's words, at least, that are the task's and the agent's own."""


def ungrounded(lesson: Lesson, episode: MemoryEpisode) -> str:
    """Why a lesson that a model wrote does not rest on its episode, "" where it does.

    Its evidence stands in the transcript word for word; a third of its words are about what the task names, what can be
    handled, or what the agent did; and no more of them stand only in what was returned to the agent.
    """
    transcript = _flat(episode.transcript)
    passages = [_flat(passage) for passage in lesson.evidence]
    if not any(len(passage) >= SHORTEST for passage in passages):
        return "it names no evidence in the episode"
    if any(passage not in transcript for passage in passages):
        return "its evidence does not stand in the episode"
    acts = acts_of(episode.transcript)
    own = terms(" ".join([episode.task.query, *episode.task.things, *acts]))
    said = terms(lesson.content)
    if len(said & (terms(episode.transcript) - own)) > len(said & own):
        return "it passes on what a tool returned"
    if len(said & own) < ABOUT * len(said) or not said:
        return "it is not about what the task names or the agent did"
    return ""


def _flat(text: str) -> str:
    return " ".join(_WORD.findall(text.casefold()))
