"""The sub-commands, one module each, with ``main(argv) -> exit status``; :mod:`gvla2.cli` dispatches to them."""
