"""The process that the server runs in."""

import multiprocessing
import os
import signal
import socket
import threading
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path

import numpy as np
from drjit.llvm import ad

from ..core.host import to_array
from ..scene.scene import Scene
from .session import Session

# Bytes of a message of a page
LARGEST_MESSAGE = 1 << 16


@dataclass(frozen=True)
class Opening:
    """What a page shows at first; it can be sent to another process."""

    scene: Scene
    folder: Path  # where things are saved
    name: str  # of the scene's file
    target: np.ndarray | None = None  # linear RGB of shape (height, width, 3)
    share: bool = False  # several pages may be open at once

    def session(self) -> Session:
        """A session of it.

        Raises:
            ValueError: pictures of the scene are too large to be looked at, or the target is.
        """
        session = Session(self.scene, self.folder, self.name)
        if self.target is not None:
            flat = np.asarray(self.target, np.float32).ravel()
            session.set_target(ad.TensorXf(to_array(flat, len(flat)), self.target.shape))
        return session


def run(opening: Opening, listening: socket.socket, token: str) -> None:
    """Serve until a signal; the process ends with the one that has started it.

    Args:
        listening: a socket that listens.
        token: of the address.
    """
    import uvicorn

    from .server import app_of

    # Ctrl-C in the terminal is for the process that has started this one. While the server runs it
    # has handlers of its own
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    port = listening.getsockname()[1]
    config = uvicorn.Config(
        app_of(opening.session(), port, token, opening.share),
        log_level="warning",
        access_log=False,
        ws="websockets-sansio",
        ws_max_size=LARGEST_MESSAGE,
        # Pictures are compressed already
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=2,
        server_header=False,
    )
    uvicorn.Server(config).run(sockets=[listening])


def _end_with_parent() -> None:
    """End this process when the one that has started it ends, however that comes."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
