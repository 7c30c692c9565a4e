"""``python -m gvla2``: the command line, where the installed script is not on the PATH."""

import sys

from gvla2.cli import main

if __name__ == "__main__":
    sys.exit(main())
