"""Feed damaged files to `load_scene` and `read_image`, and count what comes of them.

    python benchmarks/fuzz.py [--inputs 20000] [--seed 0] [--keep FOLDER] [--only NUMBER]

A file has to be read, or refused: with a `SceneError` of which each line names the file, or with a
`ValueError` of one line that names it. All else is a failure: another exception, a process that
ends, or more than the time limit. For each failure a line is printed and the input is kept; the
exit status is 1 if there is any.

Inputs are read in batches, each in a process of its own. That process tells the number of each
input before it reads it, so that the input that ends it is known. An input depends on nothing but
the seed and its number.
"""

import argparse
import collections
import io
import os
import re
import resource
import select
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np

SCENES = Path(__file__).parent.parent / "scenes"
# Time that one input may take
SECONDS = 20.0
# Bytes that a process may address, so that a file that claims to be huge cannot take the machine's
# memory
MEMORY = 8 << 30
# Inputs that one process reads
BATCH = 1000
# One scene file of so many is from `LARGE_SCENES`
LARGE_EVERY = 500
# What the names of inputs that failed begin with
KEPT = "kept-"

# What takes the place of a value in a scene file
VALUES = [
    "0",
    "-1",
    "1e400",
    "-1e308",
    "1e-320",
    "nan",
    "-inf",
    "9" * 400,
    "0x10",
    "1_000",
    "true",
    '""',
    '"x"',
    "[]",
    "{}",
    "[1, 2]",
    "[1, 2, 3, 4]",
    "[[1], 2, 3]",
    "1979-05-27T07:32:00Z",
    "07:32:00",
    "'''a\nb'''",
    '"\\u0000"',
    '"\\U0010FFFF"',
    "[nan, 0, 0]",
    "{ a = 1 }",
    "[{}]",
    "'é'",
    "[1e18, 1e18, 1e18]",
    "1e18",
    "1e-18",
    "257",
    "1048577",
    "[1048576, 1048576]",
]


def damaged(rng: np.random.Generator, data: bytes) -> bytes:
    """A copy with its bytes damaged in one to four ways."""
    for _ in range(rng.integers(1, 5)):
        data = DAMAGES[rng.integers(len(DAMAGES))](rng, data)
    return data


def _truncated(rng: np.random.Generator, data: bytes) -> bytes:
    return data[: rng.integers(0, len(data) + 1)]


def _flipped(rng: np.random.Generator, data: bytes) -> bytes:
    """Up to eight bits flipped."""
    values = np.frombuffer(data, np.uint8).copy()
    for place in rng.integers(0, max(len(data), 1), rng.integers(1, 9)) if data else ():
        values[place] ^= 1 << rng.integers(8)
    return values.tobytes()


def _overwritten(rng: np.random.Generator, data: bytes) -> bytes:
    """One, four or eight bytes replaced by those of an extreme number."""
    place = rng.integers(0, len(data) + 1)
    number = rng.choice(np.array([0, 1, -1, 1 << 31, (1 << 31) - 1, 1 << 62, -(1 << 62)]))
    new = int(number).to_bytes(8, "little", signed=True)[: rng.choice([1, 4, 8])]
    return data[:place] + new + data[place + len(new) :]


def _moved(rng: np.random.Generator, data: bytes) -> bytes:
    """A slice copied to a place before it, in front of what is there or over it."""
    a, b, c, d = np.sort(rng.integers(0, len(data) + 1, 4))
    return data[:a] + data[c:d] + data[rng.choice([a, b]) :]


def _noise(rng: np.random.Generator, data: bytes) -> bytes:
    place = rng.integers(0, len(data) + 1)
    return data[:place] + rng.bytes(rng.integers(1, 20)) + data[place:]


DAMAGES: list[Callable] = [_truncated, _flipped, _overwritten, _moved, _noise]


def scene_input(rng: np.random.Generator, number: int) -> bytes:
    """A scene file with damaged bytes, wrong values or mixed lines, or a large or deep one."""
    whole = _scenes()[rng.integers(len(_scenes()))]
    if number % LARGE_EVERY == 0:
        return LARGE_SCENES[number // LARGE_EVERY % len(LARGE_SCENES)]()
    kind = rng.integers(6)
    if kind == 0:
        return damaged(rng, whole)
    text = whole.decode()
    if kind == 1:
        return _lines_mixed(rng, text).encode()
    for _ in range(rng.integers(1, 6)):
        text = _value_replaced(rng, text) if rng.random() < 0.8 else _word_replaced(rng, text)
    return text.encode() if kind < 5 else damaged(rng, text.encode())


@cache
def _scenes() -> list[bytes]:
    """The project's scene files."""
    return [path.read_bytes() for path in sorted(SCENES.glob("*.toml"))]


def _value_replaced(rng: np.random.Generator, text: str) -> str:
    """The value behind some equals sign, or some number, replaced by one of `VALUES`."""
    pattern = r"(?<== )[^\n#]+" if rng.random() < 0.6 else r"-?\d+\.?\d*"
    places = list(re.finditer(pattern, text))
    if not places:
        return text
    place = places[rng.integers(len(places))]
    return text[: place.start()] + VALUES[rng.integers(len(VALUES))] + text[place.end() :]


def _word_replaced(rng: np.random.Generator, text: str) -> str:
    """A word of the file replaced by another one, or by what is no word or not known."""
    places = list(re.finditer(r"[A-Za-z_]\w*", text))
    if not places:
        return text
    place, other = (places[i] for i in rng.integers(len(places), size=2))
    new = (
        other[0]
        if rng.random() < 0.7
        else rng.choice(["", "a.b", '"a b"', "é", "__proto__", "camera.fov", '""', "-", "1"])
    )
    return text[: place.start()] + str(new) + text[place.end() :]


def _lines_mixed(rng: np.random.Generator, text: str) -> str:
    """Up to two lines replaced by up to two copies of another, one to five times."""
    lines = text.split("\n")
    for _ in range(rng.integers(1, 6)):
        a, b = rng.integers(len(lines), size=2)
        lines[a : a + rng.integers(0, 3)] = [lines[b]] * rng.integers(0, 3)
        lines = lines or [""]
    return "\n".join(lines)


CAMERA = (
    b"[camera]\nposition = [0, 0, 3]\nlook_at = [0, 0, 0]\nfov = 50\nresolution = [8, 8]\n"
    b"[materials.a]\n"
)
BALL = b'[[spheres]]\ncenter = [0, 0, 0]\nradius = 1\nmaterial = "a"\n'
LARGE_SCENES: list[Callable[[], bytes]] = [
    lambda: b"",
    lambda: CAMERA + BALL * 100_000,
    lambda: CAMERA + b"[[spheres]]\n" * 20_000,
    lambda: b"a = " + b"[" * 50_000 + b"]" * 50_000,
    lambda: b"a = " + b"{a = " * 20_000,
    lambda: b"[" + b"a." * 20_000 + b"a]\n",
    lambda: b".".join([b"a"] * 20_000) + b" = 1\n",
    lambda: CAMERA + b"".join(b"[materials.m%d]\n" % i for i in range(20_000)),
    lambda: CAMERA + b"".join(b"k%d = 1\n" % i for i in range(20_000)),
    lambda: b'a = "' + b"x" * 5_000_000 + b'"',
    lambda: b"\xff\xfe" + (CAMERA + BALL).decode().encode("utf-16-le"),
    lambda: b"\xef\xbb\xbf" + CAMERA + BALL,
    lambda: b"\0" * 1_000_000,
    lambda: CAMERA + BALL * 1000,
    lambda: CAMERA + b'[["spheres"]]\n' + b"#" * 3_000_000,
]


def exr_input(rng: np.random.Generator, number: int) -> bytes:
    """An EXR file of some kind; nine of ten are damaged."""
    import OpenEXR

    shape = tuple(rng.integers(1, 20, 2))
    kinds = [
        OpenEXR.NO_COMPRESSION,
        OpenEXR.ZIP_COMPRESSION,
        OpenEXR.ZIPS_COMPRESSION,
        OpenEXR.PIZ_COMPRESSION,
        OpenEXR.RLE_COMPRESSION,
        OpenEXR.B44_COMPRESSION,
        OpenEXR.DWAA_COMPRESSION,
    ]
    layout = OpenEXR.scanlineimage if rng.random() < 0.7 else OpenEXR.tiledimage
    header = {
        "type": layout,
        "compression": kinds[rng.integers(len(kinds))],
        "note": "x" * rng.integers(1, 40),
    }
    if layout == OpenEXR.tiledimage:
        header["tiles"] = OpenEXR.TileDescription()
    dtype = [np.float32, np.float16][rng.integers(2)]
    names = ["RGB", "RGBA", "Z", "Y"][rng.choice(4, p=[0.6, 0.2, 0.1, 0.1])]
    pixels = rng.normal(size=shape if len(names) == 1 else (*shape, len(names))).astype(dtype)
    with tempfile.NamedTemporaryFile(suffix=".exr") as file:
        with OpenEXR.File(header, {names: pixels}) as image:
            image.write(file.name)
        data = Path(file.name).read_bytes()
    return data if rng.random() < 0.1 else damaged(rng, data)


def png_input(rng: np.random.Generator, number: int) -> bytes:
    """A PNG file of some kind; nine of ten are damaged, half of these with correct checksums."""
    from PIL import Image

    mode = ["RGB", "RGBA", "L", "LA", "P", "1", "I;16"][
        rng.choice(7, p=[0.5, 0.2, 0.06, 0.06, 0.06, 0.06, 0.06])
    ]
    size = tuple(int(n) for n in rng.integers(1, 20, 2))
    image, file = Image.new(mode, size), io.BytesIO()
    if mode in ("RGB", "RGBA"):
        image = Image.fromarray(rng.integers(0, 256, (*size, len(mode)), dtype=np.uint8))
    image.save(file, "PNG", optimize=bool(rng.random() < 0.3))
    data = file.getvalue()
    if rng.random() < 0.1:
        return data
    return _with_checksums(damaged(rng, data)) if rng.random() < 0.5 else damaged(rng, data)


def _with_checksums(data: bytes) -> bytes:
    """A PNG with every chunk's checksum corrected, so that readers look at what is in the chunk."""
    out, place = bytearray(data), 8
    while place + 12 <= len(out):
        length = int.from_bytes(out[place : place + 4], "big")
        end = place + 8 + length
        if end + 4 > len(out):
            break
        out[end : end + 4] = zlib.crc32(out[place + 4 : end]).to_bytes(4, "big")
        place = end + 4
    return bytes(out)


KINDS = {"toml": scene_input, "exr": exr_input, "png": png_input}


def make(seed: int, number: int) -> tuple[str, bytes]:
    """The kind and the bytes of an input. Half of all inputs are scene files."""
    rng = np.random.default_rng((seed, number))
    kind = ("toml", "exr", "toml", "png")[number % 4]
    return kind, KINDS[kind](rng, number)


def outcome(path: Path) -> str:
    """What reading a file comes to.

    Returns:
        "read", the name of an error that is allowed, or "FAILURE: " and why.
    """
    import whitted as wt

    try:
        if path.suffix == ".toml":
            scene = wt.load_scene(path)
            values = [np.ravel(value.numpy()) for value in scene.parameters().values()]
            finite = np.isfinite(np.concatenate(values)).all()
            return "read" if finite else "FAILURE: parameters that are not finite"
        image = wt.read_image(path)
        return "read" if image.shape[2:] == (3,) else f"FAILURE: an image of shape {image.shape}"
    except wt.SceneError as error:
        known = all(line.startswith(str(path)) for line in str(error).split("\n"))
        return "SceneError" if known else f"FAILURE: {str(error)[:200]!r}"
    except (ValueError, OSError) as error:
        # Python's own messages, such as those of UnicodeDecodeError, do not help a user
        known = type(error) is ValueError and str(path) in str(error) and "\n" not in str(error)
        return "ValueError" if known else f"FAILURE: {type(error).__name__}: {error}"
    except BaseException as error:
        return f"FAILURE: {type(error).__name__}: {error}"


def batch(seed: int, first: int, last: int, folder: Path) -> None:
    """Read some inputs, and print a line for each.

    The first half of the line is printed before the input is read, the second half after.
    """
    import whitted  # noqa: F401  (before the address space is limited: LLVM takes much of it)

    # OpenEXR prints to standard output as well, which must not mix with the lines
    out = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    for number in range(first, last):
        kind, data = make(seed, number)
        path = folder / f"{number}.{kind}"
        path.write_bytes(data)
        print(number, path.name, end=" ", flush=True, file=out)
        start = time.perf_counter()
        result = outcome(path)
        seconds = time.perf_counter() - start
        if any(each != path and not each.name.startswith(KEPT) for each in folder.iterdir()):
            result = "FAILURE: left another file"
        print(f"{seconds:.3f} {result}".replace("\n", " "), flush=True, file=out)
        if result.startswith("FAILURE"):
            path.rename(folder / f"{KEPT}{path.name}")
        else:
            path.unlink()


def results(seed: int, inputs: int, folder: Path) -> Iterator[tuple[str, float, str]]:
    """Name, seconds and outcome of every input.

    When a process ends too early, the next one begins behind the input that ended it.
    """
    first = 0
    while first < inputs:
        last = min(first + BATCH, inputs)
        for line in _lines(seed, first, last, folder):
            number, name, *rest = line.split(" ", 3)
            yield (
                (name, float(rest[0]), rest[1].strip())
                if len(rest) > 1
                else (name, SECONDS, "FAILURE: the process ended")
            )
            first = int(number) + 1


def _lines(seed: int, first: int, last: int, folder: Path) -> Iterator[str]:
    """The lines that a batch in a process of its own prints."""
    arguments = ["--seed", str(seed), "--batch", str(first), str(last), "--keep", str(folder)]
    command = [sys.executable, __file__, *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0
    ) as process:
        yield from _watched(process)
    # The input that ended the process is still there
    for path in folder.glob("[0-9]*"):
        path.rename(folder / f"{KEPT}{path.name}")


def _watched(process: subprocess.Popen) -> Iterator[str]:
    """The lines that a process prints. It is ended when it prints nothing for too long."""
    text = b""
    while True:
        ready, _, _ = select.select([process.stdout], [], [], SECONDS + 20)
        data = process.stdout.read(1 << 16) if ready else b""
        if not data:
            process.kill()
            break
        *lines, text = (text + data).split(b"\n")
        yield from (line.decode() for line in lines)
    if text:
        yield text.decode()


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=20_000, help="how many files to read")
    parser.add_argument("--seed", type=int, default=0, help="another seed makes other files")
    parser.add_argument(
        "--keep",
        type=Path,
        metavar="FOLDER",
        help="folder for files that fail [default: a new one]",
    )
    parser.add_argument(
        "--only",
        type=int,
        metavar="NUMBER",
        help="write the input of this number to standard output, and read nothing",
    )
    parser.add_argument("--batch", type=int, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    folder = options.keep or Path(tempfile.mkdtemp(prefix="fuzz-"))
    folder.mkdir(parents=True, exist_ok=True)
    if options.only is not None:
        sys.stdout.buffer.write(make(options.seed, options.only)[1])
        return 0
    if options.batch:
        batch(options.seed, *options.batch, folder)
        return 0
    return report(results(options.seed, options.inputs, folder), folder)


def report(found: Iterator[tuple[str, float, str]], folder: Path) -> int:
    """Print the failures, the counts and the slowest input.

    Args:
        found: name, seconds and outcome of every input.

    Returns:
        The exit status.
    """
    counts: dict[str, collections.Counter] = collections.defaultdict(collections.Counter)
    slowest, failures = (0.0, ""), 0
    for name, seconds, result in found:
        counts[name.rpartition(".")[2]][result.split(":")[0]] += 1
        slowest = max(slowest, (seconds, name))
        if seconds > SECONDS or result.startswith("FAILURE"):
            failures += 1
            print(f"{name}: {result} ({seconds:.1f} s)", flush=True)
    for kind, counter in sorted(counts.items()):
        outcomes = ", ".join(f"{n} {result}" for result, n in counter.most_common())
        print(f"{kind}: {sum(counter.values())} inputs: {outcomes}")
    kept = f", kept in {folder}" if failures else ""
    print(f"slowest: {slowest[1]}, {slowest[0]:.2f} s; failures: {failures}{kept}")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
