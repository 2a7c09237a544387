"""Choose the libLLVM that Dr.Jit loads; standard library only, since Dr.Jit looks for it once,
while it is imported.

Run as a script, it prints the library it would choose, or says what is missing and exits with
status 1.
"""

import ctypes
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

VARIABLE = "DRJIT_LIBLLVM_PATH"
OLDEST = 15  # the oldest that Dr.Jit takes; it cannot select fmaximum and fminimum, which no kernel here holds
ALL_WORKS = 16
PACKAGES = "^libllvm[0-9]+(t64)?$"
FOLDERS = (
    *("usr/local/lib", "usr/lib/*-linux-gnu*", "lib/*-linux-gnu*", "usr/lib64", "usr/lib"),
    *("usr/lib/llvm*/lib*", "usr/lib/llvm/*/lib*", "usr/lib64/llvm*/lib*"),
    *(
        "opt/homebrew/opt/llvm*/lib",
        "usr/local/opt/llvm*/lib",
        "home/linuxbrew/.linuxbrew/opt/llvm*/lib",
    ),
)
# libLLVM-19.so, libLLVM-15.so.1, libLLVM.so.19.1, libLLVM.19.1.dylib; and libLLVM.so, which does
# not tell
FILE_NAME = re.compile(r"libLLVM(?:(?:[-.]|\.so\.)(\d+)[\d.]*)?(?:\.so|\.dylib)?[\d.]*")


class BackendError(RuntimeError):
    """Dr.Jit has no LLVM that it can use; the message is one line with the cause and the remedy."""


@dataclass(frozen=True)
class Library:
    """A libLLVM, and why it was chosen."""

    path: str
    version: int | None  # the major version; None when the library does not tell
    reason: str


def configure() -> Library:
    """Choose the libLLVM of this process and have Dr.Jit load it; further calls have the same
    outcome.

    Raises:
        BackendError: there is no usable library, or Dr.Jit was imported before and has found none.
    """
    outcome = _outcome()
    if isinstance(outcome, BackendError):
        raise outcome
    return outcome


@cache
def _outcome() -> Library | BackendError:
    imported = "drjit" in sys.modules
    if imported:
        library = Library(
            os.environ.get(VARIABLE, "libLLVM"),
            None,
            "drjit was imported before whitted and had chosen it",
        )
    else:
        try:
            library = choose(search_folders(os.environ), os.environ)
        except BackendError as error:
            return error
    try:
        import drjit
    except (
        ImportError,
        NameError,
    ) as error:  # Dr.Jit's own handling of the first runs into the second
        return BackendError(
            f"Dr.Jit cannot be imported: {error.__context__ or error}; install what is missing (setup does)"
        )

    if drjit.has_backend(drjit.JitBackend.LLVM):
        return replace(library, version=drjit.detail.llvm_version()[0])
    if imported:
        return BackendError(
            f"drjit was imported before whitted and found no usable LLVM; import whitted first, or set {VARIABLE}"
        )
    return BackendError(f"Dr.Jit cannot use {library.path}; {remedy(os.environ)}")


def choose(folders: Sequence[Path], environ: MutableMapping[str, str]) -> Library:
    """Set Dr.Jit's variable to the library that the user named, else to the best one of some
    folders.

    Raises:
        BackendError: no library is usable.
    """
    library = find_library(folders, environ)
    if library is None:
        raise BackendError(f"{_what_is_wrong(folders)}; {remedy(environ)}")
    environ[VARIABLE] = library.path
    return library


def find_library(folders: Iterable[Path], environ: Mapping[str, str]) -> Library | None:
    """The library that the user named, else the newest one in some folders that is new enough and
    can be loaded.

    Raises:
        BackendError: the user named a library that is missing, broken or too old.
    """
    if named := environ.get(VARIABLE):
        return _named(named)
    found = candidates(folders)
    for version, path in found:
        if version >= OLDEST and loads(path):
            versions = ", ".join(str(each) for each in dict.fromkeys(each for each, _ in found))
            better = "" if version >= ALL_WORKS else f"; {ALL_WORKS} or newer is better"
            return Library(str(path), version, f"the newest that works, of LLVM {versions}{better}")
    return None


def candidates(folders: Iterable[Path]) -> list[tuple[int, Path]]:
    """Version and path of every libLLVM in some folders, newest first, each file once."""
    found: dict[Path, tuple[int, Path]] = {}
    for path in (path for folder in folders for path in sorted(folder.glob("libLLVM*"))):
        file = path.resolve()
        if file not in found and FILE_NAME.fullmatch(path.name) and file.is_file():
            version = _version(path)
            if version is not None:
                found[file] = version, path
    return sorted(found.values(), key=lambda candidate: -candidate[0])


def search_folders(environ: Mapping[str, str], root: Path = Path("/")) -> list[Path]:
    """Existing folders that may hold libLLVM: the user's own, then Conda's and Python's, then the
    system's.
    """
    own = [folder for folder in environ.get("LD_LIBRARY_PATH", "").split(os.pathsep) if folder]
    prefixes = [environ.get("CONDA_PREFIX"), sys.prefix, sys.base_prefix]
    listed = [Path(folder) for folder in own] + [
        Path(prefix, "lib") for prefix in prefixes if prefix
    ]
    listed += [folder for pattern in FOLDERS for folder in sorted(root.glob(pattern))]
    return [folder for folder in dict.fromkeys(listed) if folder.is_dir()]


def loads(path: Path | str) -> bool:
    """Whether the library can be loaded: it is whole, of this architecture, and has all it depends
    on.
    """
    try:
        ctypes.CDLL(str(path))
    except OSError:
        return False
    return True


def remedy(environ: Mapping[str, str], release: Path = Path("/etc/os-release")) -> str:
    """The command that installs a libLLVM on this system, or a sentence where it is not known."""
    sudo = "" if os.geteuid() == 0 else "sudo "
    lines = (
        re.findall(r'^ID(?:_LIKE)?="?([^"\n]*)', release.read_text(), re.MULTILINE)
        if release.is_file()
        else []
    )
    system = " ".join(lines).split()
    command = None
    if environ.get("CONDA_PREFIX"):
        command = "conda install -c conda-forge libllvm19"
    elif sys.platform == "darwin":
        command = "brew install llvm"
    elif "debian" in system:
        command = _apt(sudo)
    elif "fedora" in system:
        command = f"{sudo}dnf install llvm-libs"
    elif "arch" in system:
        command = f"{sudo}pacman -S llvm-libs"
    general = f"install the shared library of LLVM {ALL_WORKS} or newer from your system's packages"
    return (
        f"install one with: {command}" if command else general
    ) + f" (or set {VARIABLE} to the file of one)"


def _apt(sudo: str) -> str | None:
    """The newest package that apt knows; None when all are too old."""
    search = ["apt-cache", "search", "--names-only", PACKAGES]
    listing = (
        subprocess.run(search, capture_output=True, text=True, check=False).stdout
        if shutil.which(search[0])
        else ""
    )
    packages = [
        (int(number), name)
        for name, number in re.findall(r"^(libllvm(\d+)(?:t64)?)\b", listing, re.MULTILINE)
    ]
    if not packages:
        newest = f"apt-cache search --names-only '{PACKAGES}' | cut -d' ' -f1 | sort -V | tail -1"
        return f"{sudo}apt-get update && {sudo}apt-get install -y $({newest})"
    version, name = max(packages)
    return f"{sudo}apt-get install -y {name}" if version >= OLDEST else None


def _named(path: str) -> Library:
    """The library in Dr.Jit's variable, respected as it is; a name without a folder is for the
    loader to find.
    """
    version = _version(Path(path))
    fault = None
    if os.sep in path and not Path(path).is_file():
        fault = "there is no such file"
    elif version is not None and version < OLDEST:
        fault = f"LLVM {version} is too old, {OLDEST} or newer is needed"
    elif not loads(path):
        fault = "it cannot be loaded as a library"
    if fault:
        raise BackendError(
            f"{VARIABLE}={path}: {fault}; name another, or unset the variable to have one found"
        )
    return Library(path, version, f"named by {VARIABLE}")


def _version(path: Path) -> int | None:
    """The major version, by the name of the file behind the links, else of the link, else by asking
    the library.
    """
    for name in (path.resolve().name, path.name):
        match = FILE_NAME.fullmatch(name)
        if (
            match and match[1] and int(match[1]) > 2
        ):  # libLLVM.so.1 numbers the interface; its link tells the version
            return int(match[1])
    try:
        get_version = ctypes.CDLL(str(path)).LLVMGetVersion
    except (OSError, AttributeError):  # not a library, or LLVM 15 or older
        return None
    major, rest = ctypes.c_uint(), ctypes.c_uint()
    get_version(ctypes.byref(major), ctypes.byref(rest), ctypes.byref(rest))
    return major.value


def _what_is_wrong(folders: Iterable[Path]) -> str:
    found = candidates(folders)
    if not found:
        return "no libLLVM was found on this system"
    faults = [
        f"{path} (LLVM {version}) {'is too old' if version < OLDEST else 'cannot be loaded'}"
        for version, path in found
    ]
    return f"no usable libLLVM, {OLDEST} or newer, was found: {', '.join(faults)}"


if __name__ == "__main__":
    try:
        print(choose(search_folders(os.environ), os.environ).path)
    except BackendError as error:
        sys.exit(str(error))
