"""What a server and its model can do, found out by asking."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from gvla2.language.completion import Message, read_completion
from gvla2.language.failures import ModelRefusedError, ModelUnavailableError

MOST_ALTERNATIVES = 20
"""The most ``top_logprobs`` that the interface allows."""

_UNSUPPORTED = (400, 422)
"""How servers answer a parameter or a role that they do not know."""


@dataclass(frozen=True)
class Capabilities:
    """``top_logprobs`` is how many alternatives may be asked for with a token; 0 where it comes alone or not at all."""

    logprobs: bool
    top_logprobs: int
    usage: bool
    system_role: bool

    def to_json(self) -> dict[str, Any]:
        """Plain JSON."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Capabilities | None:
        """What :meth:`to_json` gave, None for anything else."""
        match document:
            case {
                "logprobs": bool(logprobs),
                "top_logprobs": int(top),
                "usage": bool(usage),
                "system_role": bool(system),
            } if 0 <= top <= 1000:
                return cls(logprobs, top, usage, system)
        return None


async def probe(ask: Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]) -> Capabilities:
    """Ask with everything; where that is refused, with less, down to a bare question.

    ``ask`` takes the parameters that vary (messages, logprobs, top_logprobs, max_tokens) and gives the JSON of the
    response. What a server accepts in silence and does not give counts as absent. Raises the last refusal when even
    the bare question is refused, and every other failure at once.
    """
    refusal: ModelRefusedError | None = None
    for alternatives in (MOST_ALTERNATIVES, 5, None):
        for system in (True, False):
            wanted: dict[str, Any] = {"messages": _question(system=system), "max_tokens": 8}
            if alternatives is not None:
                wanted |= {"logprobs": True, "top_logprobs": alternatives}
            try:
                body = await ask(wanted)
            except ModelRefusedError as error:
                if error.status not in _UNSUPPORTED:
                    raise
                refusal = error
                continue
            except ModelUnavailableError as error:
                # Some servers fail with 500 where a model's template knows no system role.
                if error.status != 500 or not system:
                    raise
                continue
            answer = read_completion(body)
            # A model that was still thinking has shown no token of an answer yet: believe what was accepted.
            counts = _alternatives(body) if answer.text else [alternatives or 0]
            given = alternatives is not None and bool(counts)
            top = alternatives if given and alternatives and max(counts) > 0 else 0
            return Capabilities(given, top, answer.usage.metered, system)
    assert refusal is not None
    raise refusal


def without_system(messages: Sequence[Message]) -> list[dict[str, Any]]:
    """The same words for a model that knows no system role: they open the first of the user's messages."""
    orders = "\n\n".join(str(m["content"]) for m in messages if m.get("role") == "system")
    rest = [dict(m) for m in messages if m.get("role") != "system"]
    if not orders:
        return rest
    for message in rest:
        if message.get("role") == "user":
            message["content"] = f"{orders}\n\n{message['content']}"
            return rest
    return [{"role": "user", "content": orders}, *rest]


def _question(*, system: bool) -> list[dict[str, Any]]:
    question = [{"role": "user", "content": "Say the one word: yes"}]
    return [{"role": "system", "content": "You answer with one word."}, *question] if system else question


def _alternatives(body: Mapping[str, Any]) -> list[int]:
    """How many alternatives each token of this response has; empty when there are no log-probabilities."""
    match body:
        case {"choices": [{"logprobs": {"content": [*entries]}}, *_]}:
            return [_length(e.get("top_logprobs")) for e in entries if isinstance(e, Mapping)]
    return []


def _length(listed: object) -> int:
    return len(listed) if isinstance(listed, Sequence) else 0
