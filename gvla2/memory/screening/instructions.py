"""Text that reads like an order to the machine that plans, rather than like experience.

A small English screen. It lowers trust and does nothing else: what keeps orders out is where a text comes from
(:mod:`gvla2.memory.curation.trust`), for no list of words is ever complete.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from gvla2.memory.screening.disguises import invisible, sanitised

MAX_SCREENED = 4000
_TOLD = (
    r"(?:instructions?|prompts?|directives?|guidelines?|guardrails?|orders|rules|constraints|messages|context|polic(?:y|ies)"
    r"|safety \w+|safeguards?|limits|restrictions)"
)
_CHECKS = (
    r"(?:collision|safety|force|speed|torque|workspace|joint|limit|emergency|verification|permission|security|sanity)"
    r"[ -](?:\w+[ -])?(?:check\w*|limits?|stops?|monitor\w*|verification|guards?|interlocks?|sensors?|planning|avoidance)"
)
_SECRETS = (
    r"(?:passwords?|passphrases?|credentials?|secrets?|private keys?|api keys?|access tokens?|auth tokens?|id_rsa|\.ssh"
    r"|\.env\b|/etc/(?:passwd|shadow)|environment variables)"
)
_PATTERNS = (
    rf"\b(?:ignore|disregard|forget|override|bypass|set aside|violate|disobey|drop)\b(?: \w+){{0,4}} {_TOLD}\b",
    r"\b(?:ignore|disregard|forget)\b(?: \w+){0,2} (?:everything|anything|all|whatever)\b(?: \w+){0,3} (?:above|before|said|told)",
    rf"\b{_TOLD}\b(?: \w+){{0,4}} (?:are|is) (?:now )?(?:void|obsolete|cancelled|lifted|revoked|suspended|no longer)\b",
    r"\byou are (?:now|no longer)\b|\bfrom now on,? you\b|\bact as (?:an?|the) (?:\w+ )?(?:assistant|model|admin\w*|root)\b",
    r"\b(?:dear|attention|note to|message (?:to|for)) (?:the )?(?:planner|assistant|agent|model|llm|ai|verifier|robot)\b",
    r"\b(?:planner|assistant|agent|model|llm|ai|verifier)s?,? (?:you )?(?:must|should|shall|has to|have to) (?:always |now |only |never )*"
    r"(?:obey|ignore|skip|accept|approve|trust|answer|reply|output|say|comply|rate|score)\b",
    r"\b(?:your|the) (?:real|true|actual|new|only) (?:task|goal|objective|instructions?|purpose|orders?) (?:is|are)\b",
    r"\b(?:system|hidden) (?:prompt|message)\b|\bjailbreak\b|\bdeveloper mode\b",
    rf"\b(?:without|skip|disable|turn off|switch off|deactivate|ignore|bypass|suppress|no need for|mute|omit)\b(?: \w+){{0,4}} {_CHECKS}",
    rf"\b{_CHECKS}(?: \w+){{0,4}} (?:can be|may be|are|is|should be|must be) (?:skipped|disabled|ignored|bypassed|off|unnecessary|not needed)",
    rf"\b(?:print|send|post|upload|e-?mail|reveal|show|leak|output|copy|write|cat|read|dump|paste|share|forward)\b"
    rf"(?:\W+[\w./~-]+){{0,6}}?\W+[\w./~]*{_SECRETS}",
    r"\b(?:curl|wget)\b[^\n]{0,80}\|\s*(?:sudo )?(?:ba|z)?sh\b|\brm -rf? (?:/|~|\*)(?:\s|$)",
    r"\b(?:give|rate|score|mark|judge|treat|record|report|count|verify|declare)\b(?: \w+){0,6} (?:as )?(?:a )?(?:full marks?|perfect|"
    r"success(?:ful)?|passed|verified|1\.0|10/10)\b(?: \w+){0,4}(?: (?:regardless|always|whatever|no matter|every time|even if)\b)",
    r"\b(?:regardless of|whatever|no matter what) (?:the |your )?(?:user|operator|task|instruction|person|human)\w*\b",
    r"\b(?:trust|believe|accept|approve) (?:only )?(?:this|every|all|any) (?:note|record|memory|lesson|request|source|plan)\w*\b",
)
_SCREEN = re.compile("|".join(f"(?:{pattern})" for pattern in _PATTERNS))
_HIDDEN = re.compile(r"[A-Za-z0-9+/]{40,}={0,2}|(?:[0-9a-f]{2}[ :]?){24,}|(?:\b\w ){8,}")
"""Long codes, and words torn into letters: nobody can say what they say."""


@lru_cache(maxsize=8192)
def screen(text: str) -> str:
    """Why a text is trusted a level less, "" for no reason: it reads like orders, or hides what it says."""
    text = text[:MAX_SCREENED]
    if sum(map(invisible, text)) > text.count("\n") + text.count("\t") + text.count("\r"):
        return "it holds characters that are not shown"
    shown = sanitised(text)
    if len(shown) < len(text) and "(link)" not in shown and text.isascii():
        return "it holds the frame of a conversation"
    if _SCREEN.search(" ".join(shown.casefold().replace("’", "'").split())) is not None:
        return "it reads like orders to a machine"
    return "it hides what it says" if _HIDDEN.search(shown) is not None else ""


def screened_effect(effect: Mapping[str, Any] | None) -> str:
    """Why a typed effect is trusted a level less: its names are sentences, or read like orders; "" for no reason."""
    for name in ("parameter", "scale", "object", "region", "skill"):
        said = str((effect or {}).get(name) or "")
        if len(said) > 80 or len(said.split()) > 6:
            return f"its {name} is no name"
        if said and (why := screen(said.replace("_", " "))):
            return why
    return ""
