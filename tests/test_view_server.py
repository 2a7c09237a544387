"""The server of the page: who may use it, what it sends, and that nothing queues up."""

import json
import re
import struct
import subprocess
import sys
import time

import numpy as np
import pytest
from view_scene import TEXT

import whitted as wt
from whitted.cli import run
from whitted.view import worker as workers
from whitted.view.session import Session

testclient = pytest.importorskip("starlette.testclient", reason="needs Starlette and httpx")
BASE, TOKEN = "http://127.0.0.1:8750", "right"
SOCKET = f"ws://127.0.0.1:8750/socket?token={TOKEN}"


@pytest.fixture
def session(tmp_path):
    return Session(wt.parse_scene(TEXT), tmp_path)


def client_of(session, share=False):
    from whitted.view.server import app_of

    return testclient.TestClient(app_of(session, 8750, TOKEN, share), base_url=BASE)


@pytest.fixture
def client(session):
    with client_of(session) as client:
        yield client


def unpacked(data):
    """The header of a frame, and its pictures by name."""
    (length,) = struct.unpack_from("<I", data)
    header = json.loads(data[4 : 4 + length])
    start, pictures = 4 + length, {}
    for name, size in header["pictures"]:
        pictures[name] = data[start : start + size]
        start += size
    assert start == len(data)
    return header, pictures


def next_of(socket, kind, shown=True):
    """The next thing of a kind that the server sends: a reply, or a frame's header."""
    while True:
        message = socket.receive()
        data = message.get("bytes")
        told = unpacked(data)[0] if data else json.loads(message["text"])
        if data and shown:
            socket.send_json({"kind": "shown"})
        if told["kind"] == kind:
            return told


def status_of_socket(client, address, **headers):
    """The code with which a socket is refused before it is accepted."""
    with (
        pytest.raises(testclient.WebSocketDisconnect) as refused,
        client.websocket_connect(address, headers=headers),
    ):
        pass
    return refused.value.code


def test_page_and_its_parts(client):
    page = client.get(f"/?token={TOKEN}")
    assert page.status_code == 200
    assert "text/html" in page.headers["content-type"]
    assert "default-src 'self'" in page.headers["content-security-policy"]
    parts = re.findall(r'(?:src|href)="(/[^"]*)"', page.text)
    assert len(parts) == 3
    for part in parts:
        assert client.get(part).status_code == 200
    assert "://" not in page.text


@pytest.mark.parametrize("path", ["/", "/?token=wrong", "/?token=", "/target", "/nothing"])
def test_wrong_token_is_refused(client, path):
    answer = client.get(path)
    assert answer.status_code == 403
    assert answer.text == (
        "the token is missing or old; open the address that whitted has printed\n"
    )


@pytest.mark.parametrize("origin", ["http://example.com", "null", "http://127.0.0.1:8751"])
def test_foreign_origin_is_refused(client, origin):
    answer = client.get(f"/?token={TOKEN}", headers={"origin": origin})
    assert (answer.status_code, answer.text) == (
        403,
        "another site's page may not use this server\n",
    )
    assert status_of_socket(client, SOCKET, origin=origin) == 1008


@pytest.mark.parametrize("host", ["example.com", "example.com:8750", "127.0.0.1", "0.0.0.0:8750"])
def test_wrong_host_is_refused(client, host):
    answer = client.get(f"/?token={TOKEN}", headers={"host": host})
    assert answer.status_code == 400
    assert answer.text == (
        "the host is not this server; open the address that whitted has printed\n"
    )


def test_socket_needs_the_token(client):
    assert status_of_socket(client, SOCKET.replace(TOKEN, "wrong")) == 1008
    assert status_of_socket(client, SOCKET, host="example.com:8750") == 1008


def test_files_beside_the_page_are_not_served(client):
    for path in ("/static/../session.py", "/static/%2e%2e/session.py", "/static//etc/passwd"):
        assert client.get(path).status_code in (403, 404)


def test_scene_and_first_frame_arrive(client, session):
    with client.websocket_connect(SOCKET, headers={"origin": BASE}) as socket:
        socket.send_json({"kind": "open"})
        scene = next_of(socket, "scene")
        assert scene["name"] == "scene.toml"
        frame = next_of(socket, "frame")
        assert frame["look"]["size"] == [48, 32]


def test_messages_change_the_scene_and_refusals_come_back(client, session):
    with client.websocket_connect(SOCKET) as socket:
        socket.send_json({"kind": "set", "name": "spheres.ball.radius", "value": [0.5]})
        while next_of(socket, "frame")["values"] != {"spheres.ball.radius": [0.5]}:
            pass
        socket.send_json({"kind": "set", "name": "spheres.ball.radius", "value": [-1]})
        told = next_of(socket, "refused")["text"]
        assert told == "spheres.ball.radius = -1: expected a number > 0"
        for text in ("{", '"set"', "[]", "null"):
            socket.send_text(text)
            assert "message: expected a kind" in next_of(socket, "refused")["text"]


def test_no_more_frames_are_on_the_way_than_allowed(client, session):
    """A page that shows nothing gets two frames; the next one has the newest state."""
    with client.websocket_connect(SOCKET) as socket:
        first = next_of(socket, "frame", shown=False)
        for k in range(1, 6):
            socket.send_json({"kind": "set", "name": "spheres.ball.radius", "value": [k / 10]})
            time.sleep(0.05)
        second = next_of(socket, "frame", shown=False)
        socket.send_json({"kind": "shown"})
        third = next_of(socket, "frame", shown=False)
    assert first["values"] == {}
    assert second["values"] != third["values"]
    assert third["values"] == {"spheres.ball.radius": [0.5]}


def test_second_page_is_refused(client):
    from whitted.view.server import BUSY

    with client.websocket_connect(SOCKET) as first:
        next_of(first, "frame")
        with client.websocket_connect(SOCKET) as second:
            closed = second.receive()
        assert (closed["code"], closed["reason"]) == (
            BUSY,
            "another page is open; close it, or start with --share",
        )
        # The first one goes on
        first.send_json({"kind": "open"})
        next_of(first, "scene")
    with client.websocket_connect(SOCKET) as third:
        next_of(third, "frame")


def test_shared_pages_show_the_same(session):
    with (
        client_of(session, share=True) as client,
        client.websocket_connect(SOCKET) as a,
        client.websocket_connect(SOCKET) as b,
    ):
        next_of(a, "frame")
        next_of(b, "frame")
        a.send_json({"kind": "set", "name": "spheres.ball.radius", "value": [0.5]})
        for socket in (a, b):
            while not next_of(socket, "frame")["values"]:
                pass


def test_target_that_is_sent(client, session, tmp_path):
    wt.write_image(tmp_path / "t.png", wt.render(session.state.scene, resolution=(40, 20)))
    data = (tmp_path / "t.png").read_bytes()
    with client.websocket_connect(SOCKET) as socket:
        address = f"/target?token={TOKEN}&name=t.png"
        assert client.post(address, content=data).status_code == 204
        assert next_of(socket, "target")["size"] == [40, 20]
        assert client.post(address, content=b"no picture").status_code == 204
        assert "t.png: not a readable PNG" in next_of(socket, "refused")["text"]
        for name in ("a.jpg", "", "../x"):
            client.post(f"/target?token={TOKEN}&name={name}", content=data)
            assert "expected a picture that ends in" in next_of(socket, "refused")["text"]


def test_target_that_is_too_large(client, monkeypatch):
    from whitted.view import server

    monkeypatch.setattr(server, "LARGEST", 1 << 20)
    answer = client.post(f"/target?token={TOKEN}&name=t.png", content=bytes((1 << 20) + 1))
    assert answer.status_code == 413
    assert answer.text == "target: a file of more than 1 MiB; scale the picture"


def test_errors_of_ours_are_told_and_the_page_goes_on(client, session, monkeypatch):
    def fails(*_):
        raise OSError("no such thing")

    with client.websocket_connect(SOCKET) as socket:
        next_of(socket, "frame")
        with monkeypatch.context() as patch:
            patch.setattr(session, "frame", fails)
            socket.send_json({"kind": "set", "name": "spheres.ball.radius", "value": [0.5]})
            told = next_of(socket, "refused")["text"]
            assert told == "this did not work, and the last step is taken back: no such thing"
            patch.setattr(session, "frame", lambda *_: (_ for _ in ()).throw(MemoryError))
            socket.send_json({"kind": "rest"})
            socket.send_json({"kind": "undo"})
            told = next_of(socket, "refused")["text"]
            assert told == "not enough memory; choose a smaller size, or fewer samples"
        socket.send_json({"kind": "undo"})
        assert next_of(socket, "frame")["values"] == {}


def test_a_slow_picture_is_announced(client, session, monkeypatch):
    monkeypatch.setattr(workers, "SLOW", 0.05)
    quick = session.frame
    with client.websocket_connect(SOCKET) as socket:
        next_of(socket, "frame")
        monkeypatch.setattr(session, "frame", lambda *asked: time.sleep(0.3) or quick(*asked))
        socket.send_json({"kind": "set", "name": "spheres.ball.radius", "value": [0.5]})
        next_of(socket, "working")
        assert next_of(socket, "frame")["values"]


def test_of_messages_in_a_row_the_last_one_counts():
    def drag(x, how="across"):
        return 1, {"kind": "drag", "x": x, "y": 0, "how": how}

    keep, shown = (1, {"kind": "keep"}), (1, {"kind": "shown"})
    kept = workers.newest([drag(1), drag(2), shown, drag(3), keep, drag(4), drag(5, "along")])
    assert kept == [drag(2), shown, drag(3), keep, drag(4), drag(5, "along")]
    a, b = (page, {"kind": "set", "name": "x", "value": [1]}) if (page := 1) else None, drag(1)
    assert workers.newest([a, a, b, a]) == [a, b, a]
    assert workers.newest([(1, None), (1, None)]) == [(1, None), (1, None)]


@pytest.mark.parametrize("name", [None, "camera.fov"])
def test_a_picture_at_rest_is_interrupted(session, name):
    from whitted.view.pictures import InterruptedPictureError

    session.handle({"kind": "differentiate", "name": name})
    session.frame()
    session.handle({"kind": "rest"})
    with pytest.raises(InterruptedPictureError):
        session.frame(lambda: True)
    assert session.state.stale
    header, _ = session.frame()
    assert not header["moving"]


def test_numbers_of_frames_are_json(session):
    """Also where a derivative is nowhere finite, there is no NaN in a header."""
    header, pictures = session.frame()
    assert unpacked(workers.packed(header, pictures)) == (
        {**header, "pictures": [[name, len(data)] for name, data in pictures.items()]},
        pictures,
    )


COMMAND = [sys.executable, "-m", "whitted", "view"]


def started(*arguments):
    """A server in a process of its own, and its address."""
    process = subprocess.Popen(
        [*COMMAND, *map(str, arguments), "--no-browser"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    line = process.stdout.readline()
    found = re.search(r"http://\S+", line)
    assert found, line + process.communicate()[1]
    return process, found[0]


def test_command_serves_until_interrupted(tmp_path):
    import signal
    import urllib.request

    (tmp_path / "a.toml").write_text(TEXT)
    process, address = started(tmp_path / "a.toml")
    try:
        assert address.startswith("http://127.0.0.1:")
        page = urllib.request.urlopen(address, timeout=10).read().decode()
        assert '<div id="app">' in page
    finally:
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=10)
    assert errors == ""
    assert process.returncode == 130


def test_command_refuses_bad_input(tmp_path, capsys):
    import socket

    wt.write_image(tmp_path / "large.png", np.zeros((8, 5000, 3)))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        for arguments, text in (
            (["no-such"], "no-such: there is no such file, and no shipped scene of this name"),
            (
                ["cornell", "--port", "70000"],
                "--port: expected a number from 1 to 65535, got 70000",
            ),
            (["cornell", "--port", port], f"--port: {port} is taken; choose another, or leave"),
            (["cornell", "--target", "none.png"], "none.png: cannot be read or written: No such"),
            (["cornell", "--target", tmp_path / "large.png"], "5000 x 8 has more than 4194304"),
        ):
            assert run(["view", *map(str, arguments), "--no-browser"]) == 2
            error = capsys.readouterr().err
            assert text in error
            assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("port", "message"),
    [
        (["--port", "80"], "--port: 80 is refused (Permission denied); choose another, or leave"),
        ([], "--port: no port is free; give one"),
    ],
)
def test_ports_that_the_system_refuses(monkeypatch, capsys, port, message):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("socket.socket.bind", refuse)
    assert run(["view", "cornell", "--no-browser", *port]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_server_that_ends_again_and_again(monkeypatch):
    import os

    from whitted.view import serve

    monkeypatch.setattr(serve, "run", os._exit)
    monkeypatch.setattr(serve, "TIMES", 1)
    told = []
    with pytest.raises(RuntimeError, match=r"ends again and again \(status 3\); what it has"):
        serve._keep_up((3,), told.append)
    assert told == ["the server has ended (status 3); it is started again"]


@pytest.mark.parametrize("name", ["starlette", "uvicorn", "websockets"])
def test_missing_library_is_named(monkeypatch, capsys, name):
    monkeypatch.setitem(sys.modules, name, None)
    assert run(["view", "cornell", "--no-browser"]) == 2
    assert capsys.readouterr().err == (
        f"the page needs {name}, which is missing; install it with: pip install 'whitted[view]'\n"
    )


def test_importing_the_package_imports_nothing_that_takes_long():
    code = (
        "import sys, whitted, whitted.cli; "
        "names = 'starlette', 'uvicorn', 'websockets', 'anywidget', 'scipy', 'matplotlib', 'dask'; "
        "print([name for name in names if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
