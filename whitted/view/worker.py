"""The one thread that uses a session: it takes what pages say, and renders for those that wait."""

import json
import struct
import threading
from collections.abc import Callable
from typing import Any

from .pictures import InterruptedPictureError
from .session import Reply, Session

# Takes a page's number, and a text or the bytes of a frame for it
Deliver = Callable[[int, "str | bytes"], None]
# Frames on the way to a page: one that it draws, and one that comes meanwhile
IN_FLIGHT = 2
# Seconds after which pages are told that a picture takes its time, as when kernels are compiled
SLOW = 0.7
# Messages of which only the last one in a row counts
LIVE = ("set", "drag")
# A page has drawn a frame. This one is for the worker alone
SHOWN = {"kind": "shown"}
# Replies to the page that has asked; others are for all pages
OWN = ("refused", "there", "scene")


class Worker:
    """Turns messages into replies and frames, in a thread of its own."""

    def __init__(self, session: Session, deliver: Deliver) -> None:
        self._session, self._deliver = session, deliver
        session.state.post = lambda event: self._do(
            lambda: self._tell_all(*session.on_event(event))
        )
        # Messages of pages by their numbers; and functions to call, without a number
        self._inbox: list[tuple[int | None, Any]] = []
        self._ended = False
        self._filled = threading.Condition()
        # Frames on the way, by page; and the pages that have missed the last one
        self._on_way: dict[int, int] = {}
        self._behind: set[int] = set()
        self._last = b""
        self._thread = threading.Thread(target=self._run, name="whitted-view", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """End the thread, after what it is at."""
        self._do(self._end)
        self._thread.join()
        self._session.close()

    def say(self, page: int, message: Any) -> None:
        """A page says something; from any thread."""
        self._put(page, message)

    def join(self, page: int) -> None:
        """A page is there, and gets frames."""
        self._do(lambda: self._join(page))

    def leave(self, page: int) -> None:
        """A page has gone."""
        self._do(lambda: self._leave(page))

    def target(self, name: str, data: bytes) -> None:
        """The file of a target has come."""
        self._do(lambda: self._tell_all(*self._session.take_target(name, data)))

    def _do(self, function: Callable[[], None]) -> None:
        """Call a function in the thread, in its turn."""
        self._put(None, function)

    def _put(self, page: int | None, what: Any) -> None:
        with self._filled:
            self._inbox.append((page, what))
            self._filled.notify()

    def _run(self) -> None:
        """Until the end: do what waits, then render for the pages that can take a frame."""
        self._guarded(self._session.warm)
        while not self._ended:
            with self._filled:
                self._filled.wait_for(lambda: self._inbox or self._has_work())
                waiting, self._inbox = self._inbox, []
            for page, what in newest(waiting):
                if page is None:
                    self._guarded(what)
                else:
                    self._guarded(self._take, page, what)
            self._guarded(self._render)

    def _end(self) -> None:
        self._ended = True

    def _join(self, page: int) -> None:
        self._on_way[page] = 0
        self._behind.add(page)

    def _leave(self, page: int) -> None:
        self._on_way.pop(page, None)
        self._behind.discard(page)

    def _guarded(self, function: Callable[..., None], *arguments: Any) -> None:
        """Call a function. An error of ours is told to all pages, and the thread goes on."""
        try:
            function(*arguments)
        except InterruptedPictureError:
            return
        except Exception as error:
            self._tell_all(self._session.failed(error))

    def _take(self, page: int, message: Any) -> None:
        """Do what one message says."""
        if message == SHOWN:
            self._on_way[page] = max(0, self._on_way.get(page, 0) - 1)
            return
        for reply in self._session.handle(message):
            if reply["kind"] in OWN:
                self._tell(page, reply)
            else:
                self._tell_all(reply)

    def _free(self) -> list[int]:
        """The pages that can take a frame."""
        return [page for page, count in self._on_way.items() if count < IN_FLIGHT]

    def _has_work(self) -> bool:
        free = self._free()
        return bool(free) and (self._session.state.stale or not self._behind.isdisjoint(free))

    def _interrupted(self) -> bool:
        with self._filled:
            return any(what != SHOWN for _, what in self._inbox)

    def _render(self) -> None:
        if self._ended or not self._has_work():
            return
        if self._session.state.stale:
            slow = threading.Timer(SLOW, self._tell_all, [{"kind": "working"}])
            slow.daemon = True
            slow.start()
            try:
                self._last = packed(*self._session.frame(self._interrupted))
            finally:
                slow.cancel()
            self._behind = set(self._on_way)
        for page in self._behind.intersection(self._free()):
            self._on_way[page] += 1
            self._behind.discard(page)
            self._deliver(page, self._last)

    def _tell(self, page: int, reply: Reply) -> None:
        self._deliver(page, json.dumps(reply, allow_nan=False))

    def _tell_all(self, *replies: Reply) -> None:
        for reply in replies:
            for page in list(self._on_way):
                self._tell(page, reply)


def newest(waiting: list[tuple[int | None, Any]]) -> list[tuple[int | None, Any]]:
    """Messages without those that the next one of the same page makes out of date."""
    kept: list[tuple[int | None, Any]] = []
    for page, message in waiting:
        if kept and kept[-1][0] == page and _replaces(message, kept[-1][1]):
            kept.pop()
        kept.append((page, message))
    return kept


def _replaces(message: Any, before: Any) -> bool:
    if not (isinstance(message, dict) and isinstance(before, dict)):
        return False
    alike = message.get("kind") == before.get("kind") and message.get("kind") in LIVE
    return alike and all(message.get(key) == before.get(key) for key in ("name", "how"))


def packed(header: Reply, pictures: dict[str, bytes]) -> bytes:
    """A frame as bytes: the length of the header (4 bytes, little endian), the header as JSON, and
    the pictures, whose names and lengths the header has in "pictures".
    """
    parts = [[name, len(data)] for name, data in pictures.items()]
    text = json.dumps({**header, "pictures": parts}, allow_nan=False).encode()
    return struct.pack("<I", len(text)) + text + b"".join(pictures.values())
