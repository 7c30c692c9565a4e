"""Data that the memory suite is measured on."""
