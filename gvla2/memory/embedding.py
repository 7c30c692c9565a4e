"""The default embedder: a table of token vectors, averaged. No network, no torch, a fifth of a second to load.

The table (32,000 tokens x 256 numbers, 16 MB) and its tokenizer lie in the wheel of WordLlama (Miller 2024, MIT), a
static embedding distilled from the token tables of large language models and trained for such averages. Its own
loader, which may go on-line, is not imported: the two files are read here.
"""

from __future__ import annotations

import importlib.util
import zlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError, reading
from gvla2.memory.contracts import Embedder

if TYPE_CHECKING:
    from tokenizers import Tokenizer

PACKAGE = "wordllama"
TABLE = Path("weights", "l2_supercat_256.safetensors")
TOKENIZER = Path("tokenizers", "l2_supercat_tokenizer_config.json")
_MAX_CHARS = 8192
"""Characters read of a text."""


def record_vectors(embedder: Embedder, records: Sequence[tuple[str, str]]) -> NDArray[np.float32]:
    """(N, D) unit vectors of records, given as their instructions and content; zero for empty ones.

    Half of each is the instructions' own vector, half that of the whole text: a task in other words is otherwise
    drowned out by a long lesson.
    """
    whole = embedder.embed([f"{query} {content}" for query, content in records])
    found = whole + embedder.embed([query for query, _ in records])
    lengths = np.linalg.norm(found, axis=1, keepdims=True)
    return np.asarray(found / np.where(lengths > 0, lengths, 1.0), np.float32)


class StaticEmbedder:
    """Texts to unit vectors of 256 numbers: the mean of their tokens' vectors, ignoring order and case.

    Raises :class:`~gvla2.errors.MissingDependencyError` if the package with the table is not installed, and
    :class:`~gvla2.errors.ConfigurationError` if its files are missing.
    """

    def __init__(self, folder: Path | None = None) -> None:
        what = f"the package '{PACKAGE}' (a table of token vectors, 16 MB, no download at run time)"
        folder = folder or package_folder(
            PACKAGE, what, "The embedder 'static'", f"pip install {PACKAGE}", "MIT"
        )
        self._table, self._tokenizer, self._model = _loaded(folder)

    @property
    def model(self) -> str:
        """Identifier kept with stored vectors: another table has another checksum."""
        return self._model

    def knows(self, query: str) -> bool:
        """Whether at least half of a query's letters are Latin.

        The table was trained on English. In another script it knows little more than letters, whose mean is near that
        of any other text in that script: such a query is searched by its words alone.
        """
        letters = [] if query.isascii() else [char <= "\u024f" for char in query if char.isalpha()]
        return 2 * sum(letters) >= len(letters)

    def embed(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, 256) unit rows; a text without tokens gives a zero row."""
        bare = (text[:_MAX_CHARS].casefold().encode("utf-8", "replace") for text in texts)
        plain = [text.decode("utf-8").strip() for text in bare]
        rows = np.zeros((len(texts), self._table.shape[1]), np.float32)
        encoded = self._tokenizer.encode_batch(plain, add_special_tokens=False)
        for row, tokens in zip(rows, encoded, strict=True):
            if tokens.ids:
                total = self._table[tokens.ids].sum(axis=0, dtype=np.float32)
                length = float(np.linalg.norm(total))
                row[:] = total / length if length > 0 else 0.0
        return rows


def package_folder(package: str, what: str, needed_by: str, install: str, licence: str) -> Path:
    """The folder of an installed package, which is not imported; raises :class:`MissingDependencyError`."""
    if (found := importlib.util.find_spec(package)) is None:
        raise MissingDependencyError(what, needed_by, install, licence)
    return Path(next(iter(found.submodule_search_locations or ("",))))


@lru_cache(maxsize=2)
def _loaded(folder: Path) -> tuple[NDArray[np.float16], Tokenizer, str]:
    """The (T, 256) table, its tokenizer and the model's name; several banks of a process share them."""
    from safetensors import safe_open
    from tokenizers import Tokenizer

    remedy = f"Reinstall the package: pip install --force-reinstall {PACKAGE}."
    with reading("the static embedder", folder, ConfigurationError, remedy):
        with safe_open(folder / TABLE, "numpy") as file:
            table = file.get_tensor("embedding.weight")
        tokenizer = Tokenizer.from_str((folder / TOKENIZER).read_text(encoding="utf-8"))
    tokenizer.no_padding()
    tokenizer.no_truncation()
    return table, tokenizer, f"wordllama-l2-{table.shape[1]}-{zlib.crc32(table):08x}-v2"
