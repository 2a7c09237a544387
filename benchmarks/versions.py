"""Processes that run versions of the project, to be asked in turn."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any


class Version:
    """A process of one version."""

    def __init__(self, folder: Path, code: str, **environment: str) -> None:
        """Start it.

        Args:
            folder: a clone.
            code: reads lines of JSON, and prints one for each. Its first argument is the folder.
        """
        self.process = subprocess.Popen(
            [sys.executable, "-c", code, str(folder.resolve())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **environment},
        )

    def ask(self, *what: object) -> Any:
        """What the code prints for a line."""
        assert self.process.stdin
        assert self.process.stdout
        print(json.dumps(what), file=self.process.stdin, flush=True)
        return json.loads(self.process.stdout.readline())
