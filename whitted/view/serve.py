"""Starting the server: its port, its address, the browser, and the process that it runs in.

Dr.Jit and LLVM end a process that they cannot go on with. So the server has a process of its own,
which is started again, with the same address. The page comes back by itself, and tells the new
server what had changed.
"""

import errno
import multiprocessing
import secrets
import socket
import threading
import time
import webbrowser
from collections.abc import Callable
from typing import Any

from .serving import Opening, run

HOST = "127.0.0.1"
# Where it listens unless a port is given, or this one is taken
PORT = 8750
# A server that ends within so many seconds of its start is started again so many times
SOON, TIMES = 30.0, 3


def serve(
    opening: Opening,
    tell: Callable[[str], None],
    *,
    port: int | None = None,
    browser: bool = True,
) -> None:
    """Serve a page on this machine until Ctrl-C.

    Args:
        opening: what the page shows.
        tell: called with a line for the user: the address, and later what has happened.
        port: from 1 to 65535 [default: 8750, or a free one where that is taken].
        browser: open the system's browser.

    Raises:
        RuntimeError: Starlette, uvicorn or websockets is missing; or the server ends again and
            again.
        ValueError: the port is taken, or not for this user.
    """
    require_libraries()
    with _listening(port) as listening:
        token, number = secrets.token_urlsafe(24), listening.getsockname()[1]
        address = f"http://{HOST}:{number}/?token={token}"
        tell(f"the page is at {address}\nCtrl-C ends it")
        if browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        _keep_up((opening, listening, token), tell)


def _keep_up(arguments: tuple[Any, ...], tell: Callable[[str], None]) -> None:
    """Run the server, and again whenever it ends by itself."""
    times = 0
    while True:
        process = multiprocessing.get_context("spawn").Process(target=run, args=arguments)
        start = time.monotonic()
        process.start()
        try:
            process.join()
        finally:
            # After Ctrl-C, which the terminal may or may not have sent to the server as well
            process.terminate()
            process.join()
        times = times + 1 if time.monotonic() - start < SOON else 0
        if times > TIMES:
            raise RuntimeError(
                f"the server ends again and again (status {process.exitcode}); "
                "what it has printed above may tell why"
            )
        tell(f"the server has ended (status {process.exitcode}); it is started again")


def require_libraries() -> None:
    """Refuse to start without the libraries of the extra.

    Raises:
        RuntimeError: one is missing; the message has the command that installs it.
    """
    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
        import websockets  # noqa: F401
    except ImportError as error:
        raise RuntimeError(
            f"the page needs {error.name}, which is missing; "
            "install it with: pip install 'whitted[view]'"
        ) from None


def _listening(port: int | None) -> socket.socket:
    """A socket that listens on the port, or on a free one where none was asked for.

    Raises:
        ValueError: the port is taken, or not for this user.
    """
    if port is not None and not 1 <= port <= 65535:
        raise ValueError(f"--port: expected a number from 1 to 65535, got {port}")
    for number in (PORT, 0) if port is None else (port,):
        found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            found.bind((HOST, number))
            found.listen()
        except OSError as error:
            found.close()
            if port is not None:
                taken = error.errno == errno.EADDRINUSE
                why = "is taken" if taken else f"is refused ({error.strerror})"
                raise ValueError(
                    f"--port: {port} {why}; choose another, or leave --port out"
                ) from None
        else:
            return found
    raise ValueError("--port: no port is free; give one")
