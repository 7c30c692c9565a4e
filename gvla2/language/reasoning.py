"""Telling a model's answer from its reasoning, in its text and in its stream of log-probabilities."""

from __future__ import annotations

import re

_OPEN = re.compile(r"\s*<think(?:ing)?>", re.IGNORECASE)
_CLOSE = re.compile(r"</think(?:ing)?>", re.IGNORECASE)
_SPECIAL = re.compile(r"(?:\s|<\|[^<>]{0,64}\|>|<[a-z_]{1,32}>|</s>|\[/?[A-Z_]{1,16}\])*", re.IGNORECASE)
_ASCII_TAIL = re.compile(r"[\x00-\x7f]*\Z")


def split_reasoning(content: str) -> tuple[str, str]:
    """(reasoning, answer) of a text that may begin with a ``<think>`` block.

    The block ends at the *last* closing tag, since reasoning may quote one; an opening tag may be missing (it is
    then part of the prompt), and without a closing tag an opened block never ended: there is no answer.
    """
    closings = list(_CLOSE.finditer(content))
    opening = _OPEN.match(content)
    if closings:
        begin = opening.end() if opening else 0
        return content[begin : closings[-1].start()].strip(), content[closings[-1].end() :].strip()
    if opening:
        return content[opening.end() :].strip(), ""
    return "", content


def locate_answer(stream: bytes, answer: str, reasoning: str) -> tuple[int, int] | None:
    """Where the answer lies in a stream of tokens that may hold the reasoning too.

    Gives (offset in the stream, offset in the answer), in bytes, of the answer's beginning; or of its last stretch of
    ASCII, where a server's tokens do not spell the rest. None when the end of the stream is not the end of the
    answer, or belongs to the reasoning: such log-probabilities say nothing about the answer.
    """
    whole = answer.strip()
    if not whole:
        return None
    skipped = len(answer[: len(answer) - len(answer.lstrip())].encode())
    tail_match = _ASCII_TAIL.search(whole)
    tail = tail_match.group() if tail_match else ""
    for wanted in (whole, tail):
        sought = wanted.encode(errors="replace")
        at = stream.rfind(sought) if sought else -1
        if at < 0 or not _SPECIAL.fullmatch(stream[at + len(sought) :].decode(errors="replace")):
            continue
        thought = reasoning.strip().encode(errors="replace")
        began = stream.find(thought) if thought else -1
        if began >= 0 and at < began + len(thought):
            return None
        return at, skipped + len(whole.encode(errors="replace")) - len(sought)
    return None
