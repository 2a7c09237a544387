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
# The shell ends at once, and what it has started goes on
REMOVE = '(sleep "$1"; rm -f "$2/$3"; rmdir "$2") </dev/null >/dev/null 2>&1 &'


def view(path: Path) -> bool:
    """Show a picture file, and remove it and its folder later.

    Returns:
        Whether there is a program that shows it. The file stays where there is none.
    """
    if not any(_takes(command, path) for command in COMMANDS if shutil.which(command[0])):
        return False
    removing = ["sh", "-c", REMOVE, "sh", str(KEPT), str(path.parent), path.name]
    subprocess.run(removing, check=False, start_new_session=True)
    return True


def _takes(command: tuple[str, ...], path: Path) -> bool:
    """Whether a command shows a picture; one that cannot ends soon."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(
        [*command, str(path)], stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True
    )
    try:
        return process.wait(PATIENCE) == 0
    except subprocess.TimeoutExpired:
        # It goes on by itself; Python would warn of a process that it knows to be running
        process.returncode = 0
        return True
