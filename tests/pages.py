"""Programs of the documentation's pages, as they stand there."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import gvla2

DOCS = Path(__file__).parents[1] / "docs"


@contextmanager
def plugin_of(page: str, number: int) -> Iterator[str]:
    """The page's program of that number, registered as a plugin; yields its text."""
    text = re.findall(r"^```python\n(.*?)^```", (DOCS / page).read_text(), re.DOTALL | re.MULTILINE)[number]
    module = ModuleType(f"page_{number}")
    exec(compile(text, page, "exec"), module.__dict__)
    gvla2.register(module)
    yield text
    gvla2.unregister(module.__name__)
