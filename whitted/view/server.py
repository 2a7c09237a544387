"""The server of the page: its files, the socket, and targets that are sent."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count
from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from .guard import App, Guard
from .session import Session
from .targets import LARGEST
from .worker import Worker

STATIC = Path(__file__).parent / "static"
# A page that is told this closes for good, or tries again later
BUSY = 4409


class Pages:
    """The pages that are open, by number, and what is to be sent to each."""

    def __init__(self, share: bool) -> None:
        self.share = share
        self._queues: dict[int, asyncio.Queue[str | bytes]] = {}
        self._numbers = count()
        self._loop: asyncio.AbstractEventLoop | None = None

    def open(self) -> tuple[int, "asyncio.Queue[str | bytes]"] | None:
        """The number and the queue of a new page; None where there is one, and one is all."""
        if self._queues and not self.share:
            return None
        self._loop = asyncio.get_running_loop()
        number = next(self._numbers)
        self._queues[number] = asyncio.Queue()
        return number, self._queues[number]

    def close(self, number: int) -> None:
        self._queues.pop(number, None)

    def deliver(self, number: int, what: str | bytes) -> None:
        """Send something to a page; from any thread."""

        def put() -> None:
            if number in self._queues:
                self._queues[number].put_nowait(what)

        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(put)


def app_of(session: Session, port: int, token: str, share: bool = False) -> App:
    """The server's application.

    Args:
        session: what it shows; only this application may use it.
        port: that it listens on.
        token: of the address.
        share: whether several pages may be open at once.
    """
    pages = Pages(share)
    worker = Worker(session, pages.deliver)

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        worker.start()
        yield
        await asyncio.to_thread(worker.stop)

    async def page(_: Request) -> Response:
        return FileResponse(STATIC / "page.html")

    async def target(request: Request) -> Response:
        data = await _body(request)
        if data is None:
            text = f"target: a file of more than {LARGEST >> 20} MiB; scale the picture"
            return PlainTextResponse(text, 413)
        worker.target(request.query_params.get("name", ""), data)
        return Response(status_code=204)

    async def socket(websocket: WebSocket) -> None:
        await websocket.accept()
        opened = pages.open()
        if opened is None:
            await websocket.close(BUSY, "another page is open; close it, or start with --share")
            return
        await _serve(websocket, worker, pages, *opened)

    routes = [
        Route("/", page),
        Route("/target", target, methods=["POST"]),
        WebSocketRoute("/socket", socket),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    return Guard(Starlette(routes=routes, lifespan=lifespan), port, token)


async def _serve(
    websocket: WebSocket,
    worker: Worker,
    pages: Pages,
    number: int,
    queue: "asyncio.Queue[str | bytes]",
) -> None:
    """Pass on messages of a page, and what there is for it, until it goes."""

    async def send() -> None:
        while True:
            what = await queue.get()
            if isinstance(what, str):
                await websocket.send_text(what)
            else:
                await websocket.send_bytes(what)

    worker.join(number)
    sending = asyncio.create_task(send())
    try:
        while True:
            worker.say(number, await _message(websocket))
    except (WebSocketDisconnect, RuntimeError):
        # It is closed, or the line broke while something was sent
        return
    finally:
        sending.cancel()
        pages.close(number)
        worker.leave(number)


async def _message(websocket: WebSocket) -> object:
    """What a page says; a text that is no JSON is refused like any other bad message."""
    try:
        return await websocket.receive_json()
    except (ValueError, KeyError):
        return None


async def _body(request: Request) -> bytes | None:
    """The body of a request, None where it is too large."""
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > LARGEST:
            return None
    return bytes(data)
