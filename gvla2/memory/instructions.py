"""Text that talks to a machine rather than about a task: orders, imitated markup, requests for secrets."""

from __future__ import annotations

import re
import unicodedata
from functools import cache

MAX_READ = 20_000

_ORDERS = re.compile(
    r"""
    \b(ignore|disregard|forget|override|bypass|circumvent)\b .{0,40}
        \b(instruction|prompt|rule|message|constraint|polic|check|limit|guardrail|verdict|verifier)
    | \b(disable|skip|turn\s+off|switch\s+off)\b .{0,30}
        \b(safety|collision|workspace|joint)\s+(check|limit|margin|monitor|stop)
    | \b(disable|skip)\b .{0,20} \b(verifier|verification|guardrail|admission)
    | \b(ignorier|vergiss|missachte|umgeh)\w*\b .{0,40} \b(anweisung|regel|befehl|vorgabe|sicherheits)
    | \b(ignore[zr]?|oublie[zr]?|contourne[zr]?)\b .{0,40} \b(instructions|consignes|règles)
    | \b(ignora|olvida|dimentica|omite)\b .{0,40} \b(instrucciones|reglas|istruzioni|regole)
    | \b(игнорируй|забудь)\w*\b .{0,40} \b(инструкци|правил)
    | (忽略|无视|忘记|無視|忘れ) .{0,12} (指令|指示|提示|规则|規則|命令)
    | (指示|命令|ルール|指令) .{0,6} (無視|忘れ)
    | \byou\s+are\s+now\s+(an?|the|my|no\s+longer|free|in)\b | \bfrom\s+now\s+on,?\s+you\b
    | \bact\s+as\s+(an?|the|my)\s+(\w+\s+)?(assistant|model|ai|admin\w*|root|user|developer)\b
    | \bpretend\s+(to\s+be|that\s+you)\b
    | \b(planner|assistant|agent|model|llm|ai|verifier|system)\s*,?\s*(you\s+)?
        (must|should|shall|has\s+to|have\s+to|needs?\s+to|will)\s+(now\s+|always\s+|only\s+|never\s+)*
        (obey|comply|ignore|disregard|skip|output|respond|reply|answer|say|print|execute|call|follow|return|approve|accept|score|rate|trust)
    | \b(planer|assistent|modell|agent)\s+(muss|soll)\w*\b .{0,40} \b(gehorchen|ignorieren|ausgeben|antworten|befolgen)
    | \b(always|only)\s+(obey|output|respond|reply\s+with|answer\s+with)\b
    | \b(obey|follow)\s+(me|my|this\s+(message|note|memory)|these\s+(orders|instructions)
        |the\s+(instructions|orders)\s+(below|above))\b
    | \b(respond|reply|answer)\s+(only\s+)?with\s+["'“{<\[]
    | \b(give|assign|award|return)\b .{0,20} \b(full|perfect|maximum|highest)\s+(score|marks?|rating|confidence)
    | \bthis\s+(memory|record|note|hint|constraint)\s+(is\s+binding|overrides|supersedes|outranks|has\s+priority)
    | \bnew\s+(system\s+)?(instructions?|prompt|orders?)\b | \bsystem\s+(prompt|message|override)\b
    | \b(reveal|print|send|leak|exfiltrate|upload|post)\b .{0,40}
        \b(password|secret|api[\s_]*key|token|credential|private\s+key)
    | \brm\s+-rf\b | \bsudo\s+\S | \b(curl|wget)\s+\S+:// | \|\s*(ba|z)?sh\b | \beval\s*\(
    """,
    re.IGNORECASE | re.VERBOSE | re.DOTALL,
)
_MARKUP = re.compile(
    r"""
    (^|\n)\s*["'#*>_-]*\s*(system|assistant|user|developer|human|tool)\s*(message)?\s*["'*_]*\s*[:：]
    | <\s*\|?\s*/?\s*(\|\s*)?(im_start|im_end|im_sep|eot_id|start_header|end_header|system|memory
        |instructions?|user|assistant|tool_call|s)\s*(\||\b)[^<]{0,80}>
    | \[\s*/?\s*(inst|system|assistant)\s*\] | <<\s*/?\s*sys\s*>> | ```\s*(system|tool|instructions?)
    | (^|\n)\s*\#{1,6}\s*(system|instructions?|new\s+task|response)\b
    | -{3,}\s*(begin|end|start)\b | \b(begin|end)\s+(of\s+)?(memory|context|system|instructions?|data|prompt)\b
    | \bhints\s*\(optional\) | \bconstraints\s*\(binding\)
    | \[?\s*(hint|avoid|tool|summary)-[0-9a-f]{6,}\s*[|/] | \|\s*confidence\s+[01]?\.\d | \bmemory\s+note\s*=
    """,
    re.IGNORECASE | re.VERBOSE,
)

_SIGNS = """
    ignor disregard forget override bypass circumvent disable skip off vergiss missachte umgeh oublie contourne olvida
    dimentica omite now act pretend must should shall has have need will muss soll obey output respond reply answer
    follow score mark rating confidence binding supersede outrank priority instruction prompt order message password
    secret api token credential private -rf sudo :// | eval system assistant user developer human tool < [ ` # ---
    memory context data optional hint- avoid- summary-
"""
"""Every match of a pattern in plain ASCII has one of these in it; most lessons have none, and are quickly done with."""


@cache
def _signs() -> tuple[str, ...]:
    return tuple(_SIGNS.split())


def reads_like_instructions(text: str) -> bool:
    """Whether a text gives orders to a machine or imitates the markup around what machines read.

    Errs on the careful side. Compatibility forms, invisible characters and look-alike brackets don't hide anything.
    """
    text = text[:MAX_READ]
    if text.isascii() and text.isprintable():
        low = text.lower()
        if not any(map(low.__contains__, _signs())):
            return False
        return any(pattern.search(text) is not None for pattern in (_ORDERS, _MARKUP))
    plain = unicodedata.normalize("NFKC", text).translate(_BRACKETS)
    visible = "".join(c for c in plain if c in "\n\t" or unicodedata.category(c)[0] != "C")
    visible = visible.replace("\u2028", "\n").replace("\u2029", "\n")
    letters = visible.translate(_LOOKALIKES)
    return any(
        pattern.search(words) is not None for words in {visible, letters} for pattern in (_ORDERS, _MARKUP)
    )


_BRACKETS = str.maketrans({"‹": "<", "›": ">", "«": "<", "»": ">", "〈": "<", "〉": ">", "⟨": "<", "⟩": ">"})
# Cyrillic and Greek letters that look like Latin ones.
_LOOKALIKES = str.maketrans(
    "аеорсухіјѕԁІЈЅνκαοιΙΑΒΕΗΚΜΝΟΡΤΧАВЕКМНОРСТХ", "aeopcyxijsdIJSvkaoiIABEHKMNOPTXABEKMHOPCTX"
)
