"""A test server: an OpenAI-compatible model on a local port, with scripted answers and failures."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any


@dataclass(frozen=True)
class Reply:
    """One response. ``body`` is JSON, or bytes sent as they are.

    The server waits ``delay`` seconds first, then sends a byte every ``drip`` seconds if that is above 0, and hangs up
    after ``cut`` bytes of the body if given.
    """

    body: Mapping[str, Any] | bytes
    status: int = 200
    headers: Mapping[str, str] = field(default_factory=dict)
    delay: float = 0.0
    drip: float = 0.0
    cut: int | None = None


Answering = Callable[[dict[str, Any]], Reply | dict[str, Any]]
"""From a request's JSON to the answer."""


def said(
    text: str | None,
    tokens: Sequence[tuple[str | bytes, Mapping[str, float]]] = (),
    *,
    reasoning: str = "",
    finish: str = "stop",
) -> dict[str, Any]:
    """A completion's JSON. ``tokens`` are (token, probabilities of the alternatives), in order."""
    message = {"role": "assistant", "content": text}
    if reasoning:
        message["reasoning_content"] = reasoning
    entries = []
    for token, odds in tokens:
        others = [_entry(t, math.log(p)) for t, p in odds.items() if p > 0]
        entries.append({**_entry(token, math.log(odds.get(_word(token), 1.0))), "top_logprobs": others})
    return {
        "id": "local",
        "object": "chat.completion",
        "model": "local",
        "choices": [
            {
                "index": 0,
                "message": message,
                "finish_reason": finish,
                "logprobs": {"content": entries} if entries else None,
            }
        ],
        "usage": {"prompt_tokens": 100, "completion_tokens": 10, "total_tokens": 110},
    }


def refused(status: int, message: str, **headers: str) -> Reply:
    """An error in the form that OpenAI-compatible servers use; ``retry_after="2"`` becomes the header."""
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return Reply({"error": {"message": message, "type": "error", "code": status}}, status, named)


class LocalModel:
    """An OpenAI-compatible server on a free local port, until the ``with`` block ends.

    ``answering`` is called for each requested completion, in its own thread. ``requests`` are the bodies received, in
    order; ``busiest`` is the largest number in flight at once; ``models`` are those it lists.
    """

    def __init__(self, answering: Answering, models: Sequence[str] = ("local",)) -> None:
        self.requests: list[dict[str, Any]] = []
        self.headers: list[dict[str, str]] = []
        self.busiest = 0
        self._answering = answering
        self._models = models
        self._lock = threading.Lock()
        self._busy = 0
        self._closing = threading.Event()
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True)

    @property
    def url(self) -> str:
        """The ``base_url``."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/v1"

    def __enter__(self) -> LocalModel:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._closing.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def _reply(self, body: dict[str, Any], headers: dict[str, str]) -> Reply:
        with self._lock:
            self.requests.append(body)
            self.headers.append(headers)
            self._busy += 1
            self.busiest = max(self.busiest, self._busy)
        try:
            answer = self._answering(body)
            reply = answer if isinstance(answer, Reply) else Reply(answer)
            self._closing.wait(reply.delay)
            return reply
        finally:
            with self._lock:
                self._busy -= 1

    def _handler(model) -> type[BaseHTTPRequestHandler]:  # noqa: N805 - 'self' is the handler's
        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                size = int(self.headers.get("content-length", 0))
                headers = {name.title(): value for name, value in self.headers.items()}  # clients differ here
                self._send(model._reply(json.loads(self.rfile.read(size)), headers))

            def do_GET(self) -> None:
                self._send(Reply({"object": "list", "data": [{"id": name} for name in model._models]}))

            def _send(self, reply: Reply) -> None:
                body = reply.body if isinstance(reply.body, bytes) else json.dumps(reply.body).encode()
                headers = {
                    "content-type": "application/json",
                    "content-length": str(len(body)),
                    **reply.headers,
                }
                try:
                    self.send_response(reply.status)
                    for name, value in headers.items():
                        self.send_header(name, value)
                    self.end_headers()
                    self._write(body[: reply.cut], reply.drip)
                except OSError:  # the client hung up, as impatient clients do
                    self.close_connection = True

            def _write(self, body: bytes, drip: float) -> None:
                if drip <= 0:
                    self.wfile.write(body)
                    return
                for i in range(len(body)):
                    if model._closing.is_set():
                        return
                    self.wfile.write(body[i : i + 1])
                    time.sleep(drip)

            def log_message(self, format: str, *args: object) -> None:
                """Tests are quiet."""

        return Handler


def _word(token: str | bytes) -> str:
    return token if isinstance(token, str) else token.decode(errors="replace")


def _entry(token: str | bytes, logprob: float) -> dict[str, Any]:
    spelt = token if isinstance(token, bytes) else token.encode()
    return {"token": _word(token), "logprob": logprob, "bytes": list(spelt)}
