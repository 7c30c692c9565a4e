"""Prompt injections in their disguises: invisible characters, chat frames, addresses, phrases.

A small English screen, which only lowers trust: the real defence is a text's origin
(:mod:`gvla2.memory.curation.trust`), since no list of words is complete.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

_BLANK = frozenset("\u00ad\u034f\u061c\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0")
"""Invisible characters of other categories."""
_VARIATION = re.compile("[\ufe00-\ufe0f\U000e0100-\U000e01ef\U000e0000-\U000e007f]")
_URL = re.compile(
    r"\b(?:[a-z][a-z0-9+.-]{1,12}://|www\.)[^\s<>\"'()]+|\b(?:data|javascript):[^\s]+", re.IGNORECASE
)
_FRAMES = re.compile(
    r"<\|[^|>\n]{1,40}\|>|\[/?(?:INST|SYS|SYSTEM|USER|ASSISTANT)\]|<</?SYS>>|</?(?:s|system|user|assistant|tool|memory"
    r"|instructions?|prompt|human|function_calls?|think)\b[^>\n]{0,40}>|^\s*#{2,}\s*(?:system|instructions?|user|assistant)\b:?"
    r"|^\s*(?:system|assistant|user|human|developer)\s*:\s|```+",
    re.IGNORECASE | re.MULTILINE,
)


@lru_cache(maxsize=65536)
def invisible(letter: str) -> bool:
    """Whether a character is invisible, or changes its neighbours' display: controls, joiners, tags, fillers."""
    if letter.isascii():
        return not letter.isprintable()
    return (
        unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
        or letter in _BLANK
        or _VARIATION.match(letter) is not None
    )


def sanitised(text: str) -> str:
    """``text`` made safe as data in a prompt: no invisible characters, no chat frames, no addresses.

    Lines and tabs stay. A frame's content stays as plain words; an address becomes "(link)".
    """
    plain = text
    if not (text.isascii() and text.isprintable()):
        letters = unicodedata.normalize("NFKC", text)
        # Each letter is asked about once: a text may be a megabyte.
        hidden = [ord(letter) for letter in set(letters).difference("\n\t") if invisible(letter)]
        plain = letters.translate(dict.fromkeys(hidden)) if hidden else letters
    for _ in range(3):  # a frame may be hidden in another
        stripped = _FRAMES.sub(" ", plain)
        if stripped == plain:
            break
        plain = stripped
    return _URL.sub("(link)", plain)


MAX_SCREENED = 4000
_TOLD = (
    r"(?:instructions?|prompts?|directives?|guidelines?|guardrails?|orders|rules|constraints|messages|polic(?:y|ies)"
    r"|safety \w+|safeguards?|restrictions)"
)
_CHECKS = (
    r"(?:collision|safety|force|speed|torque|workspace|joint|emergency|verification|permission|security|sanity)[ -]"
    r"(?:\w+[ -])?(?:check\w*|limits?|stops?|monitor\w*|verification|guards?|interlocks?|sensors?|planning|avoidance)"
)
_SECRETS = (
    r"(?:passwords?|passphrases?|credentials?|secrets?|private keys?|api keys?|access tokens?|auth tokens?|id_rsa"
    r"|\.ssh|\.env\b|/etc/(?:passwd|shadow)|environment variables|system prompt)"
)
_READER = r"(?:planner|assistant|agent|(?:language )?model|llm|ai|verifier|robot)"
_SWITCH_OFF = (
    r"\b(?:without|skip|disable|turn off|switch off|deactivate|ignore|bypass|suppress|no need for|omit)\b"
)
_LEAK = (
    r"(?<!never )(?<!not )(?<!n't )"
    r"\b(?:print|send|post|upload|e-?mail|reveal|show|leak|output|write|cat|read out|dump|paste|share|forward|repeat)\b"
)
_PATTERNS = (
    # Overriding earlier instructions.
    rf"\b(?:ignore|disregard|forget|override|bypass|set aside|violate|disobey|drop)\b(?: \w+){{0,4}} {_TOLD}\b",
    r"\b(?:ignore|disregard|forget)\b (?:everything|anything|all (?:of )?(?:the )?(?:above|previous|prior))\b",
    rf"\b{_TOLD}\b(?: \w+){{0,4}} (?:are|is) (?:now )?(?:void|obsolete|cancelled|lifted|revoked|suspended|no longer)\b",
    r"\b(?:your|the) (?:real|true|actual|new|only) (?:task|goal|objective|instructions?|purpose|orders?) (?:is|are)\b",
    r"\bregardless of (?:what )?(?:the |your )?(?:user|operator|task|instruction|person|human)\b",
    # A new role, or addressing the model.
    r"\byou are (?:now|no longer)\b|\bfrom now on,? you\b",
    r"\bact as (?:an?|the) (?:\w+ )?(?:assistant|model|admin\w*|root)\b",
    r"\bjailbreak\b|\bdeveloper mode\b|\"role\":",
    rf"\b(?:dear|attention|note to|message (?:to|for)|hey|hello)[ ,]+(?:the |any )?{_READER}\b",
    rf"\b{_READER}s?,? (?:you )?(?:must|should|shall|has to|have to) (?:always |now |only |never )*"
    r"(?:obey|ignore|skip|accept|approve|trust|answer|reply|output|say|comply|rate|score)\b",
    r"\b(?:trust|believe|accept|approve) (?:only )?(?:this|every|all|any) (?:note|record|memory|lesson|plan)\w*\b",
    r"\b(?:rate|score|mark|judge|treat|record|report|count|verify|declare)\b(?: \w+){0,6} "
    r"(?:full marks?|perfect|success(?:ful)?|passed|verified)\b(?: \w+){0,4} (?:regardless|always|whatever)\b",
    # Disabling a check, leaking a secret, running foreign code.
    rf"{_SWITCH_OFF}(?: \w+){{0,4}} {_CHECKS}",
    rf"\b{_CHECKS}(?: \w+){{0,4}} (?:can be|may be|are|is|should be|must be) "
    r"(?:skipped|disabled|ignored|bypassed|off|unnecessary|not needed)",
    rf"{_LEAK}(?:\W+[\w./~-]+){{0,6}}?\W+[\w./~]*{_SECRETS}",
    r"\b(?:curl|wget)\b[^\n]{0,80}\|\s*(?:sudo )?(?:ba|z)?sh\b|\brm -rf? (?:/|~|\*)(?:\s|$)",
)
_SCREEN = "|".join(f"(?:{pattern})" for pattern in _PATTERNS)  # compiled when the first text is screened
_HIDDEN = re.compile(r"[A-Za-z0-9+/]{40,}={0,2}|(?:[0-9a-f]{2}[ :]?){24,}|(?:\b\w ){8,}")
"""Long codes and s p a c e d letters: their content is hidden."""


@lru_cache(maxsize=8192)
def screen(text: str) -> str:
    """Why a text is trusted one level less, "" if it is not: it reads like orders, or hides its content."""
    text = text[:MAX_SCREENED]
    if sum(map(invisible, text)) > text.count("\n") + text.count("\t") + text.count("\r"):
        return "it holds characters that are not shown"
    shown = sanitised(text)
    if len(shown) < len(text) and "(link)" not in shown and text.isascii():
        return "it holds the frame of a conversation"
    if re.search(_SCREEN, " ".join(shown.casefold().replace("’", "'").split())) is not None:
        return "it reads like orders to a machine"
    return "it hides what it says" if _HIDDEN.search(shown) is not None else ""


def screened_effect(effect: Mapping[str, Any] | None) -> str:
    """Why a typed effect is trusted one level less: its names are sentences, or read like orders; "" if it is not."""
    for name in ("parameter", "scale", "object", "region", "skill"):
        said = str((effect or {}).get(name) or "")
        if len(said) > 80 or len(said.split()) > 6:
            return f"its {name} is no name"
        if said and (why := screen(said.replace("_", " "))):
            return why
    return ""
