"""Work for processes that die or are ended. Worker processes load this module: it imports little."""

import os
import time
from pathlib import Path


def dies_once(flag: str) -> str:
    """Ends its process the first time it is called with a flag that is a file's name."""
    if flag.startswith("/") and not Path(flag).exists():
        Path(flag).touch()
        os._exit(3)
    return flag.upper()


def dies(_: int) -> None:
    """Ends its process."""
    os._exit(3)


def sleeps(folder: str) -> None:
    """Tells the process's number and does not return."""
    Path(folder, str(os.getpid())).touch()
    time.sleep(600)
