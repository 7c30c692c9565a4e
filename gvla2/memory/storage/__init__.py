"""The bank on disk: records, links, episodes and a hash-chained history, in SQLite or PostgreSQL."""
