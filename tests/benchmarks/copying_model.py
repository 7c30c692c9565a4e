"""A "model" that answers with the last example of its prompt: the plain baseline of planners that are shown successes.

    python tests/benchmarks/copying_model.py 8899
    gvla2 bench experiment=agent3d_memory teacher=skill arms=[on] layouts=[223,224,225] language=endpoint \
        language.base_url=http://127.0.0.1:8899/v1 language.grammars=true
"""

import json
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class Copying(BaseHTTPRequestHandler):
    """The two requests of OpenAI's protocol that a planner makes."""

    def do_GET(self) -> None:
        """The list of models."""
        self._answer({"object": "list", "data": [{"id": "copier", "object": "model"}]})

    def do_POST(self) -> None:
        """The last answer among the messages."""
        asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        said = [m["content"] for m in asked["messages"] if m["role"] == "assistant"] or ["nothing to copy"]
        message = {"role": "assistant", "content": said[-1]}
        choice = {"index": 0, "finish_reason": "stop", "message": message}
        usage = {"prompt_tokens": 0, "completion_tokens": 0, "total_tokens": 0}
        about = {"id": "copy", "object": "chat.completion", "created": 0, "model": "copier"}
        self._answer({**about, "choices": [choice], "usage": usage})

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""

    def _answer(self, told: object) -> None:
        body = json.dumps(told).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    ThreadingHTTPServer(("127.0.0.1", int(sys.argv[1])), Copying).serve_forever()
