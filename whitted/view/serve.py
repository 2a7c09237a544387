"""Starting the server: its port, its address, and the browser."""

import errno
import secrets
import socket
import threading
import webbrowser
from collections.abc import Callable

from .session import Session

HOST = "127.0.0.1"
# Where it listens unless a port is given, or this one is taken
PORT = 8750
# Bytes of a message of a page
LARGEST_MESSAGE = 1 << 16


def serve(
    session: Session,
    tell: Callable[[str], None],
    *,
    port: int | None = None,
    browser: bool = True,
    share: bool = False,
) -> None:
    """Serve a page on this machine until Ctrl-C.

    Args:
        session: what the page shows.
        tell: called with the address, once the server listens.
        port: from 1 to 65535 [default: 8750, or a free one where that is taken].
        browser: open the system's browser.
        share: let several pages be open at once; they show the same scene.

    Raises:
        RuntimeError: Starlette, uvicorn or websockets is missing.
        ValueError: the port is taken, or not for this user.
    """
    require_libraries()
    import uvicorn

    from .server import app_of

    listening = _listening(port)
    token, number = secrets.token_urlsafe(24), listening.getsockname()[1]
    address = f"http://{HOST}:{number}/?token={token}"

    class Server(uvicorn.Server):
        async def startup(self, sockets: "list[socket.socket] | None" = None) -> None:
            await super().startup(sockets)
            if self.started:
                tell(address)
                if browser:
                    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    config = uvicorn.Config(
        app_of(session, number, token, share),
        log_level="warning",
        access_log=False,
        ws="websockets-sansio",
        ws_max_size=LARGEST_MESSAGE,
        # Pictures are compressed already
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=2,
        server_header=False,
    )
    with listening:
        Server(config).run(sockets=[listening])


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
                why = (
                    "is taken"
                    if error.errno == errno.EADDRINUSE
                    else f"is refused ({error.strerror})"
                )
                raise ValueError(
                    f"--port: {port} {why}; choose another, or leave --port out"
                ) from None
        else:
            return found
    raise ValueError("--port: no port is free; give one")
