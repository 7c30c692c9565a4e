"""Addresses of databases: a password may hold anything, and no message has one."""

from gvla2.io.database_url import parsed, shown


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
