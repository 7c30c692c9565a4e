"""The packages: folders of code by two rules, since conf/ and plugins/ are mapped. All else is in pyproject.toml."""

from setuptools import find_packages, setup

setup(
    packages=[
        *find_packages(include=["gvla2", "gvla2.*"]),
        "gvla2.conf",
        "gvla2_plugins",
        *(f"gvla2_plugins.{name}" for name in find_packages("plugins")),
    ]
)
