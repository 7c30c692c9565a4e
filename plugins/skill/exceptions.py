"""Exceptions: what a sentence says is not to be done, and not to what. It is heeded, or the sentence is declined."""

from __future__ import annotations

from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.grounding import ground_all
from gvla2_plugins.skill.intents import Denial, Intent


def excepted(intent: Intent, scene: Scene) -> frozenset[str] | Abstention:
    """The ids that a sentence rules out; a refusal where what it rules out cannot be told or leaves nothing to do."""
    out: set[str] = set()
    for denial in intent.denials:
        words = denial.text.split()
        if lexicon.REMAINDER & set(words):
            continue  # "not the others"
        mishap = any(w.startswith(lexicon.MISHAPS) for w in words)
        phrase = denial.phrase
        if phrase is None or phrase.pronoun or phrase.everywhere:
            if not mishap and _contradicts(denial, intent):
                return Abstention("other", f"It asks to {intent.skill} and says not to: '{denial.text}'.")
            continue
        found = ground_all(phrase, scene)
        if not found and not mishap and not denial.verbs:
            return Abstention("nothing_matches", f"What is meant by not '{denial.text}' cannot be told.")
        out |= {o.id for o in found}
    return frozenset(out)


def _contradicts(denial: Denial, intent: Intent) -> bool:
    """Whether a denial that names nothing forbids what is asked; one without a verb is not understood at all."""
    asked = {phrase.split()[0] for phrase in lexicon.VERBS.get(intent.skill, ())}
    if intent.skill in ("pick", "place"):
        asked |= lexicon.TAKING
    elsewhere = bool(set(denial.text.split()) & (lexicon.TABLE_WORDS | lexicon.STAYING))
    return bool(denial.verbs & asked) if denial.verbs else not elsewhere
