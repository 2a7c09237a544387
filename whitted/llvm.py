"""Choose the libLLVM that Dr.Jit loads.

Dr.Jit looks for the library once, while it is imported. So this module imports nothing but the
standard library.

Run as a script, it prints the library that it would choose; or it says what is missing, and exits
with status 1.
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
# The oldest version that Dr.Jit takes. It cannot compile fmaximum and fminimum, which no kernel
# here has
OLDEST = 15
# From this version on all of Dr.Jit works
ALL_WORKS = 16
PACKAGES = "^libllvm[0-9]+(t64)?$"
HOMEBREW = ("opt/homebrew", "usr/local", "home/linuxbrew/.linuxbrew")
FOLDERS = (
    *("usr/local/lib", "usr/lib/*-linux-gnu*", "lib/*-linux-gnu*", "usr/lib64", "usr/lib"),
    *("usr/lib/llvm*/lib*", "usr/lib/llvm/*/lib*", "usr/lib64/llvm*/lib*"),
    *(f"{prefix}/opt/llvm*/lib" for prefix in HOMEBREW),
)
# libLLVM-19.so, libLLVM-15.so.1, libLLVM.so.19.1, libLLVM.19.1.dylib; and libLLVM.so, whose name
# does not tell its version
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
    """Choose the libLLVM of this process and have Dr.Jit load it.

    Further calls have the same outcome.

    Raises:
        BackendError: there is no usable library, or Dr.Jit was imported before and found none.
    """
    outcome = _outcome()
    if isinstance(outcome, BackendError):
        raise outcome
    return outcome


@cache
def _outcome() -> Library | BackendError:
    imported = "drjit" in sys.modules
    if imported:
        reason = "drjit was imported before whitted and had chosen it"
        library = Library(os.environ.get(VARIABLE, "libLLVM"), None, reason)
    else:
        try:
            library = choose(search_folders(os.environ), os.environ)
        except BackendError as error:
            return error
    try:
        import drjit
    # Dr.Jit's own handling of an ImportError ends in a NameError
    except (ImportError, NameError) as error:
        cause = error.__context__ or error
        return BackendError(
            f"Dr.Jit cannot be imported: {cause}; install what is missing (setup does)"
        )
    if drjit.has_backend(drjit.JitBackend.LLVM):
        return replace(library, version=drjit.detail.llvm_version()[0])
    if imported:
        return BackendError(
            "drjit was imported before whitted and found no usable LLVM; "
            f"import whitted first, or set {VARIABLE}"
        )
    return BackendError(f"Dr.Jit cannot use {library.path}; {remedy(os.environ)}")


def choose(folders: Sequence[Path], environ: MutableMapping[str, str]) -> Library:
    """Set Dr.Jit's variable to a library: the one that the user named, else the best one found.

    Raises:
        BackendError: no library is usable.
    """
    library = find_library(folders, environ)
    if library is None:
        raise BackendError(f"{_what_is_wrong(folders)}; {remedy(environ)}")
    environ[VARIABLE] = library.path
    return library


def find_library(folders: Iterable[Path], environ: Mapping[str, str]) -> Library | None:
    """The library that the user named, else the newest one in some folders that works.

    One works if it is new enough and can be loaded.

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
    """Existing folders that may hold libLLVM.

    First come the user's own, then those of Conda and Python, then those of the system.
    """
    own = [folder for folder in environ.get("LD_LIBRARY_PATH", "").split(os.pathsep) if folder]
    prefixes = [environ.get("CONDA_PREFIX"), sys.prefix, sys.base_prefix]
    listed = [Path(folder) for folder in own]
    listed += [Path(prefix, "lib") for prefix in prefixes if prefix]
    listed += [folder for pattern in FOLDERS for folder in sorted(root.glob(pattern))]
    return [folder for folder in dict.fromkeys(listed) if folder.is_dir()]


def loads(path: Path | str) -> bool:
    """Tell if the library can be loaded.

    It can if it is whole, of this architecture, and all that it depends on is there.
    """
    try:
        ctypes.CDLL(str(path))
    except OSError:
        return False
    return True


def remedy(environ: Mapping[str, str], release: Path = Path("/etc/os-release")) -> str:
    """The command that installs a libLLVM on this system, or a sentence where it is not known."""
    sudo = "" if os.geteuid() == 0 else "sudo "
    text = release.read_text() if release.is_file() else ""
    system = " ".join(re.findall(r'^ID(?:_LIKE)?="?([^"\n]*)', text, re.MULTILINE)).split()
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
    general = f"install the shared library of LLVM {OLDEST} or newer from your system's packages"
    install = f"install one with: {command}" if command else general
    return f"{install} (or set {VARIABLE} to the file of one)"


def _apt(sudo: str) -> str | None:
    """The newest package that apt knows; None when all are too old."""
    search = ["apt-cache", "search", "--names-only", PACKAGES]
    listing = ""
    if shutil.which(search[0]):
        listing = subprocess.run(search, capture_output=True, text=True, check=False).stdout
    found = re.findall(r"^(libllvm(\d+)(?:t64)?)\b", listing, re.MULTILINE)
    packages = [(int(number), name) for name, number in found]
    if not packages:
        newest = f"apt-cache search --names-only '{PACKAGES}' | cut -d' ' -f1 | sort -V | tail -1"
        return f"{sudo}apt-get update && {sudo}apt-get install -y $({newest})"
    version, name = max(packages)
    return f"{sudo}apt-get install -y {name}" if version >= OLDEST else None


def _named(path: str) -> Library:
    """The library in Dr.Jit's variable, taken as it is.

    The loader looks for a name without a folder.
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
    """The major version, if the library tells it.

    It is in the name of the file behind the links, else in the name of the link, else the library
    is asked.
    """
    for name in (path.resolve().name, path.name):
        match = FILE_NAME.fullmatch(name)
        # A small number is that of the interface, as in libLLVM.so.1
        if match and match[1] and int(match[1]) > 2:
            return int(match[1])
    try:
        get_version = ctypes.CDLL(str(path)).LLVMGetVersion
    # It is no library, or it is LLVM 15 or older
    except (OSError, AttributeError):
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
