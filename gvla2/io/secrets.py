"""Passwords and access keys in text: configurations that hold one are refused, transcripts lose them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from gvla2.errors import ConfigurationError

ACCESS_KEY = re.compile(r"\b(?:sk|hf|gsk|xai|ghp|AIza)[-_]?[A-Za-z0-9_-]{16,}|(?i:\bbearer\s+)\S{8,}")
"""Patterns of common services' access keys, and of keys in headers."""
_NAME = r"(?:[\w.-]*[_.-])?(?:key|api_?key|token|secret|\w*passw(?:or)?d|pwd|sig|signature|authorization)"
_PASSWORD = re.compile(rf"//[^\s:/?#@]*:\S+@|(?i:[?&]{_NAME}=)[^&\s]")
"""A password before the host of an address (it may contain any character), or a secret in the query behind it."""
_SECRET_OPTION = re.compile(_NAME, re.IGNORECASE)


def refuse_secrets(option: str, value: Any) -> None:
    """Raise :class:`ConfigurationError` if an option's value, or one within it, holds a password or an access key.

    Configurations go into run folders, pages, databases and trackers as they are.
    """
    if isinstance(value, Mapping):
        for name, inner in value.items():
            refuse_secrets(f"{option}.{name}".lstrip("."), inner)
    elif isinstance(value, str):
        key = ACCESS_KEY.search(value)
        named = _SECRET_OPTION.fullmatch(option.rpartition(".")[2]) and value
        if named or _PASSWORD.search(value) or (key and any(c.isdigit() for c in key[0])):
            raise ConfigurationError(
                f"{option} holds a password or an access key, which every run's folder would show. Leave it out: "
                "PostgreSQL reads a password from PGPASSWORD or ~/.pgpass, and the option api_key_env names the "
                "environment variable of a language model's key."
            )
    elif isinstance(value, Sequence):
        for inner in value:
            refuse_secrets(option, inner)
