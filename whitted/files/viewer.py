"""The system's viewer of pictures."""

import shutil
import subprocess
import sys
from pathlib import Path

# Commands that show the picture whose path follows; the first that takes it is used
LINUX = ("xdg-open",), ("display",), ("gm", "display"), ("eog",), ("xv",)
COMMANDS = (("open",),) if sys.platform == "darwin" else LINUX
# Seconds after which a command that has not failed shows the picture, and after which the file is
# removed, which the viewer has read by then
PATIENCE, KEPT = 2.0, 30.0
REMOVE = """
import pathlib, sys, time
time.sleep(float(sys.argv[1]))
path = pathlib.Path(sys.argv[2])
path.unlink(missing_ok=True)
path.parent.rmdir()
"""
# Python warns of a process that is forgotten while it runs
_running: list[subprocess.Popen[bytes]] = []


def view(path: Path) -> bool:
    """Show a picture file, and remove it and its folder later.

    Returns:
        Whether there is a program that shows it. The file stays where there is none.
    """
    if not any(_takes(command, path) for command in COMMANDS if shutil.which(command[0])):
        return False
    _start([sys.executable, "-I", "-c", REMOVE, str(KEPT), str(path)])
    return True


def _takes(command: tuple[str, ...], path: Path) -> bool:
    """Whether a command shows a picture; one that cannot ends soon."""
    try:
        return _start([*command, str(path)]).wait(PATIENCE) == 0
    except subprocess.TimeoutExpired:
        return True


def _start(command: list[str]) -> subprocess.Popen[bytes]:
    """Start a process that prints nothing and outlives this one."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(
        command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True
    )
    _running[:] = [each for each in _running if each.poll() is None] + [process]
    return process
