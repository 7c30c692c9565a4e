"""Addresses: one file has one name, a mistake is named with what is meant, and no message has a password."""

from pathlib import Path

import pytest

from gvla2.errors import ConfigurationError
from gvla2.memory.storage.addresses import parsed, settled, shown
from gvla2.memory.storage.store import Store


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("sqlite://host/x.db", r"names a host.*sqlite:///host/x\.db.*sqlite:////host/x\.db"),
        ("sqlite://x.db", r"sqlite:///x\.db from the working directory"),
        ("sqlite:///", "names no file"),
        ("sqlite:///:memory:", "names no file"),
        ("sqlite:///x.db?mode=ro", "names no file"),
        ("mysql://robot:hush@host/x", "in SQLite or PostgreSQL, not in 'mysql'"),
        ("file:///x.db", "in SQLite or PostgreSQL, not in 'file'"),
        ("", "Not a database address"),
        ("C:x.db", "Not a database address"),
        ("sqlite:///~no-such-user/x.db", "cannot be: Could not determine home"),
    ],
)
def test_mistakes_are_named(url: str, said: str) -> None:
    for opened in (Store.open, lambda url: settled(url or ":", {})):
        with pytest.raises(ConfigurationError, match=said) as caught:
            opened(url)
        assert "hush" not in str(caught.value)


def test_the_file_has_one_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path / "folder")
    real = (tmp_path / "folder" / "x.db").resolve()
    for url in ("sqlite:///x.db", f"sqlite:///{tmp_path}/link/x.db", "sqlite:///~/link/../folder/x.db", "x.db",
                "~/folder/x.db"):  # fmt: skip
        assert parsed(url).database == str(real)
        assert settled(url, {}) == f"sqlite:///{real}"
    (tmp_path / "round").symlink_to(tmp_path / "round")
    assert parsed(tmp_path / "round").database == str(tmp_path / "round")


def test_what_is_special_in_a_password_is_taken_as_it_stands() -> None:
    for password in ("hush", "hu@sh", "hu/sh", "hu:sh", "hu#sh", "a@b/c:d"):
        url = parsed(f"postgresql+psycopg://robot:{password}@host:5/bank?sslmode=prefer")
        assert (url.username, url.password, url.host, url.port) == ("robot", password, "host", 5)
        assert (url.database, dict(url.query)) == ("bank", {"sslmode": "prefer"})
    assert parsed("postgres://robot:hu%40sh@host/bank").password == "hu@sh"
    assert parsed("postgresql:///bank?host=/run/pg").query["host"] == "/run/pg"


def test_no_message_has_a_password() -> None:
    assert shown("postgresql://robot:hu@s/h@host/bank") == "postgresql://...@host/bank"
    assert shown("postgresql://host/bank?user=a&password=hush&x=1") == (
        "postgresql://host/bank?user=a&password=...&x=1"
    )
    assert shown("sqlite:////data/x.db") == "sqlite:////data/x.db"
