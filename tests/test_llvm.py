"""Which libLLVM is chosen, from where, and what a message says when there is none."""

import ctypes
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from whitted import llvm
from whitted.llvm import BackendError, Library

ROOT = Path(llvm.__file__).parents[1]
SCENE = """
[camera]
position = [0, 0, 3]
look_at = [0, 0, 0]
fov = 50
resolution = [8, 8]

[materials.glass]
color = [0.5, 0.5, 0.5]
specular = 0.5
reflection = 1.0
refraction = 1.0
fresnel = true

[[spheres]]
center = [0, 0, 0]
radius = 1
material = "glass"

[[lights]]
position = [1, 2, 3]
intensity = [1, 1, 1]
"""
# Runs before whitted is imported: the search sees one folder only
ONE_FOLDER = """
import importlib.util, pathlib, sys
spec = importlib.util.spec_from_file_location("whitted.llvm", {module!r})
sys.modules["whitted.llvm"] = llvm = importlib.util.module_from_spec(spec)
spec.loader.exec_module(llvm)
llvm.search_folders = lambda environ: [pathlib.Path({folder!r})]
"""
REAL = llvm.candidates(llvm.search_folders({}))
REAL_15 = next((path for version, path in REAL if version == 15), None)


def fake(folder: Path, *names: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).touch()
    return folder


def python(code: str, *options: str, **variables: str) -> subprocess.CompletedProcess:
    environ = {name: value for name, value in os.environ.items() if name != llvm.VARIABLE}
    command = [sys.executable, "-W", "error", *options, *(["-c", code] if code else [])]
    return subprocess.run(
        command, env=environ | variables, cwd=ROOT, capture_output=True, text=True, check=False
    )


def whitted(folder: Path, code: str) -> subprocess.CompletedProcess:
    """Run code in a process whose search for libLLVM sees one folder only."""
    return python(ONE_FOLDER.format(module=llvm.__file__, folder=str(folder)) + code)


@pytest.fixture
def all_load(monkeypatch):
    monkeypatch.setattr(llvm, "loads", lambda path: True)


# Candidates and folders


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM-19.so", 19),
        ("libLLVM-15.so.1", 15),
        ("libLLVM-12.0.1.so", 12),
        ("libLLVM-3.8.so.1", 3),
        ("libLLVM.so.19.1", 19),
        ("libLLVM.19.1.dylib", 19),
        ("libLLVM-20.dylib", 20),
    ],
)
def test_the_file_name_tells_the_version(tmp_path, name, version):
    assert llvm.candidates([fake(tmp_path, name)]) == [(version, tmp_path / name)]


@pytest.mark.parametrize(
    "name",
    ["libLLVM-19.so.gz", "libLLVM-19-rust-1.80.so", "libLLVMCore.a", "libLLVM.so", "libLLVM.dylib"],
)
def test_other_files_are_no_candidates(tmp_path, name):
    assert llvm.candidates([fake(tmp_path, name)]) == []


def test_newest_first_and_each_file_once(tmp_path):
    one, two = (
        fake(tmp_path / "one", "libLLVM-15.so.1", "libLLVM.so.19.1"),
        fake(tmp_path / "two", "libLLVM-19.so", "libLLVM-9.so"),
    )
    (one / "libLLVM-19.so").symlink_to("libLLVM.so.19.1")
    (two / "libLLVM.so").symlink_to(one / "libLLVM.so.19.1")
    (two / "libLLVM-21.so").symlink_to("missing")
    found = llvm.candidates([one, two])
    assert found == [
        (19, one / "libLLVM-19.so"),
        (19, two / "libLLVM-19.so"),
        (15, one / "libLLVM-15.so.1"),
        (9, two / "libLLVM-9.so"),
    ]


def test_the_link_tells_the_version_where_the_file_does_not(tmp_path):
    fake(tmp_path, "libLLVM.so.1")
    (tmp_path / "libLLVM-18.so").symlink_to("libLLVM.so.1")
    assert llvm.candidates([tmp_path]) == [(18, tmp_path / "libLLVM-18.so")]


def test_a_library_whose_name_does_not_tell_its_version_is_asked(tmp_path, monkeypatch):
    class Loaded:
        def __init__(self, path):
            pass

        @staticmethod
        def LLVMGetVersion(*numbers):
            for number, value in zip(numbers, (21, 1, 8), strict=True):
                number._obj.value = value

    monkeypatch.setattr(ctypes, "CDLL", Loaded)
    assert llvm.candidates([fake(tmp_path, "libLLVM.dylib")]) == [(21, tmp_path / "libLLVM.dylib")]


@pytest.mark.parametrize(
    "folder",
    [
        "usr/local/lib",
        "usr/lib",
        "usr/lib64",
        "usr/lib/x86_64-linux-gnu",
        "usr/lib/arm-linux-gnueabihf",
        "usr/lib/llvm-19/lib",
        "usr/lib/llvm/19/lib64",
        "usr/lib64/llvm19/lib64",
        "opt/homebrew/opt/llvm@19/lib",
        "usr/local/opt/llvm/lib",
        "home/linuxbrew/.linuxbrew/opt/llvm/lib",
    ],
)
def test_system_folders_are_searched(tmp_path, folder):
    (tmp_path / folder).mkdir(parents=True)
    assert tmp_path / folder in llvm.search_folders({}, root=tmp_path)


def test_the_users_folders_come_first(tmp_path, monkeypatch):
    names = ["loader", "conda/lib", "venv/lib", "python/lib", "root/usr/lib"]
    folders = [fake(tmp_path / name) for name in names]
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "venv"))
    monkeypatch.setattr(sys, "base_prefix", str(tmp_path / "python"))
    environ = {
        "LD_LIBRARY_PATH": f"{folders[0]}::{tmp_path / 'missing'}",
        "CONDA_PREFIX": str(tmp_path / "conda"),
    }
    assert llvm.search_folders(environ, root=tmp_path / "root") == folders


# The choice


def test_the_newest_that_loads_is_chosen(tmp_path, monkeypatch):
    folder = fake(tmp_path, "libLLVM-14.so", "libLLVM-15.so", "libLLVM.so.19.1", "libLLVM.so.22.1")
    monkeypatch.setattr(llvm, "loads", lambda path: "22" not in Path(path).name)
    reason = "the newest that works, of LLVM 22, 19, 15, 14"
    assert llvm.find_library([folder], {}) == Library(str(folder / "libLLVM.so.19.1"), 19, reason)


@pytest.mark.usefixtures("all_load")
def test_15_is_taken_when_nothing_newer_is_there(tmp_path):
    folder = fake(tmp_path, "libLLVM-14.so", "libLLVM-15.so")
    found = llvm.find_library([folder], {})
    assert found == Library(
        str(folder / "libLLVM-15.so"),
        15,
        "the newest that works, of LLVM 15, 14; 16 or newer is better",
    )


@pytest.mark.usefixtures("all_load")
def test_the_variable_is_set_and_then_respected(tmp_path):
    folder, environ = fake(tmp_path, "libLLVM-16.so", "libLLVM-19.so"), {}
    llvm.choose([folder], environ)
    assert environ == {llvm.VARIABLE: str(folder / "libLLVM-19.so")}
    environ[llvm.VARIABLE] = str(folder / "libLLVM-16.so")
    assert llvm.choose([folder], environ) == Library(
        str(folder / "libLLVM-16.so"), 16, "named by DRJIT_LIBLLVM_PATH"
    )


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("missing.so", "there is no such file"),
        ("libLLVM-14.so", "LLVM 14 is too old, 15 or newer is needed"),
        ("libLLVM-19.so", "it cannot be loaded as a library"),
        ("other.so", "it cannot be loaded as a library"),
    ],
)
def test_a_named_library_that_is_not_usable_is_refused(tmp_path, name, fault):
    path = fake(tmp_path, "libLLVM-14.so", "libLLVM-19.so", "other.so") / name
    with pytest.raises(
        BackendError,
        match=f"^DRJIT_LIBLLVM_PATH={path}: {fault}; name another, or unset the variable",
    ):
        llvm.find_library([], {llvm.VARIABLE: str(path)})


def test_a_named_library_may_be_left_to_the_loader():
    assert llvm.find_library([], {llvm.VARIABLE: "libc.so.6"}) == Library(
        "libc.so.6", None, "named by DRJIT_LIBLLVM_PATH"
    )


@pytest.mark.parametrize(
    ("names", "cause"),
    [
        ([], "^no libLLVM was found on this system; install "),
        (
            ["libLLVM-14.so"],
            r"^no usable libLLVM, 15 or newer, was found: "
            r"\S*libLLVM-14.so \(LLVM 14\) is too old; install ",
        ),
        (
            ["libLLVM-19.so"],
            r"^no usable libLLVM, 15 or newer, was found: "
            r"\S*libLLVM-19.so \(LLVM 19\) cannot be loaded; install ",
        ),
    ],
)
def test_nothing_usable_is_an_error_with_cause_and_remedy(tmp_path, names, cause):
    environ = {}
    with pytest.raises(BackendError, match=cause) as raised:
        llvm.choose([fake(tmp_path, *names)], environ)
    assert "\n" not in str(raised.value)
    assert environ == {}


# The remedy


def release(folder: Path, text: str) -> Path:
    path = folder / "os-release"
    path.write_text(f'NAME="Some Linux"\nVERSION_ID="1"\n{text}\n')
    return path


@pytest.mark.parametrize(("user", "sudo"), [(0, ""), (1000, "sudo ")])
@pytest.mark.parametrize(
    ("text", "command"),
    [
        ("ID=fedora", "dnf install llvm-libs"),
        ('ID="rocky"\nID_LIKE="rhel centos fedora"', "dnf install llvm-libs"),
        ("ID=arch", "pacman -S llvm-libs"),
        ("ID=endeavouros\nID_LIKE=arch", "pacman -S llvm-libs"),
    ],
)
def test_remedy_is_the_command_of_the_system(tmp_path, monkeypatch, user, sudo, text, command):
    monkeypatch.setattr(os, "geteuid", lambda: user)
    monkeypatch.setattr(sys, "platform", "linux")
    assert llvm.remedy({}, release(tmp_path, text)).startswith(
        f"install one with: {sudo}{command} (or set DRJIT_LIBLLVM_PATH"
    )


def test_remedy_of_conda_of_macos_and_of_an_unknown_system(tmp_path, monkeypatch):
    debian = release(tmp_path, "ID=debian")
    assert "with: conda install -c conda-forge libllvm19 (" in llvm.remedy(
        {"CONDA_PREFIX": "/c"}, debian
    )
    monkeypatch.setattr(sys, "platform", "darwin")
    assert "with: brew install llvm (" in llvm.remedy({}, tmp_path / "missing")
    monkeypatch.setattr(sys, "platform", "linux")
    assert llvm.remedy({}, tmp_path / "missing").startswith(
        "install the shared library of LLVM 15 or newer from your system's packages ("
    )


@pytest.mark.parametrize(
    ("packages", "remedy"),
    [
        (
            ["libllvm9", "libllvm19", "libllvm17t64", "libllvm15"],
            "install one with: sudo apt-get install -y libllvm19 (",
        ),
        (["libllvm17t64", "libllvm14"], "install one with: sudo apt-get install -y libllvm17t64 ("),
        (["libllvm15", "libllvm14"], "install one with: sudo apt-get install -y libllvm15 ("),
        (["libllvm14"], "install the shared library of LLVM 15 or newer from "),
        (
            [],
            "install one with: sudo apt-get update && sudo apt-get install -y $(apt-cache search ",
        ),
        (
            None,
            "install one with: sudo apt-get update && sudo apt-get install -y $(apt-cache search ",
        ),
    ],
)
def test_remedy_is_the_newest_package_that_apt_has(tmp_path, monkeypatch, packages, remedy):
    if packages is not None:
        lines = "".join(f"echo '{name} - runtime library'\n" for name in packages)
        (tmp_path / "apt-cache").write_text(f"#!/bin/sh\n{lines}")
        (tmp_path / "apt-cache").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(sys, "platform", "linux")
    assert llvm.remedy({}, release(tmp_path, "ID=ubuntu\nID_LIKE=debian")).startswith(remedy)


def test_setup_asks_for_the_oldest_version_that_will_do():
    """The script and its message agree with the library."""
    text = (ROOT / "setup").read_text()
    asked = re.findall(r"-ge (\d+) \]\]|LLVM (\d+) or newer", text)
    assert asked == [(str(llvm.OLDEST), ""), ("", str(llvm.OLDEST))]


# Whole processes


def test_configure_answers_the_same_again():
    library = llvm.configure()
    assert library.version >= llvm.OLDEST
    assert llvm.configure() is library


@pytest.mark.parametrize(
    ("names", "cause"),
    [([], "no libLLVM was found"), (["libLLVM-14.so.1"], r"libLLVM-14.so.1 (LLVM 14) is too old")],
)
def test_import_works_without_a_usable_library_but_names_raise(tmp_path, names, cause):
    code = "import whitted as wt; print(wt.__version__); wt.load_scene"
    done = whitted(fake(tmp_path, *names), code)
    assert done.returncode == 1
    assert done.stdout == "0.2.0\n"
    assert done.stderr.splitlines()[-1].startswith("whitted.llvm.BackendError: no ")
    assert cause in done.stderr


def test_python_itself_may_ask_for_any_attribute_without_llvm(tmp_path):
    done = whitted(fake(tmp_path), "import whitted; whitted.__wrapped__")
    assert "AttributeError: module 'whitted' has no attribute '__wrapped__'" in done.stderr


@pytest.mark.parametrize("command", ["render", "info"])
def test_the_command_line_says_in_one_line_that_llvm_is_missing(tmp_path, command):
    (tmp_path / "scene.toml").write_text(SCENE)
    arguments = {
        "render": ["render", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "out.exr")],
        "info": ["info"],
    }[command]
    done = whitted(
        fake(tmp_path / "empty"), f"from whitted.cli import run; sys.exit(run({arguments!r}))"
    )
    assert done.returncode == 2
    assert done.stderr.startswith("no libLLVM was found on this system; install ")
    assert done.stderr.count("\n") == 1


def test_a_dr_jit_that_cannot_be_imported_is_an_error_with_its_cause(tmp_path):
    (tmp_path / "drjit.py").write_text("raise ImportError('libatomic.so.1: no such file')")
    code = f"sys.path.insert(0, {str(tmp_path)!r}); import whitted; whitted.render"
    done = python(f"import sys; {code}", **{llvm.VARIABLE: llvm.configure().path})
    assert (
        "BackendError: Dr.Jit cannot be imported: libatomic.so.1: no such file; "
        "install what is missing" in done.stderr
    )


@pytest.mark.skipif(
    not [version for version, _ in REAL if version < 15], reason="needs an LLVM older than 15"
)
def test_a_real_library_that_is_too_old_is_refused(tmp_path):
    version, path = next(candidate for candidate in REAL if candidate[0] < 15)
    (tmp_path / path.name).symlink_to(path)
    done = whitted(tmp_path, "import whitted; whitted.render")
    assert f"(LLVM {version}) is too old; install " in done.stderr


@pytest.mark.skipif(REAL_15 is None, reason="needs LLVM 15")
def test_15_renders_and_differentiates(tmp_path):
    (tmp_path / "libLLVM-15.so").symlink_to(REAL_15)
    (tmp_path / "scene.toml").write_text(SCENE)
    done = whitted(
        tmp_path,
        f"""
import whitted as wt, drjit as dr
assert llvm.configure().version == dr.detail.llvm_version()[0] == 15
scene = wt.load_scene({str(tmp_path / "scene.toml")!r})
parameters = scene.parameters()
dr.enable_grad(parameters)
image = wt.render(scene.replace(parameters), boundary=False)
dr.backward(dr.mean(image))
assert dr.all(dr.isfinite(parameters["spheres.sphere0.radius"].grad))
print(image.shape, dr.max(image, axis=None) > 0.01)
""",
    )
    assert done.stdout == "(8, 8, 3) True\n", done.stderr
    assert done.returncode == 0


def test_drjit_that_was_imported_before_is_left_alone():
    named = llvm.configure().path
    done = python(
        "import drjit, whitted; print(whitted.llvm.configure().reason)", **{llvm.VARIABLE: named}
    )
    assert done.stdout == "drjit was imported before whitted and had chosen it\n"


def test_drjit_that_was_imported_before_and_found_nothing_is_refused():
    done = python("import drjit, whitted; whitted.render", **{llvm.VARIABLE: "/missing/libLLVM.so"})
    assert (
        "BackendError: drjit was imported before whitted and found no usable LLVM; "
        "import whitted first, or set" in done.stderr
    )


def test_a_named_library_that_is_not_llvm_is_refused():
    done = python("import whitted; whitted.render", **{llvm.VARIABLE: "libc.so.6"})
    assert "BackendError: Dr.Jit cannot use libc.so.6; install " in done.stderr


def test_the_module_as_a_script_prints_the_choice():
    named = llvm.configure().path
    chosen = python("", "-I", llvm.__file__, **{llvm.VARIABLE: named})
    assert (chosen.returncode, chosen.stdout, chosen.stderr) == (0, f"{named}\n", "")
    refused = python("", "-I", llvm.__file__, **{llvm.VARIABLE: "/missing/libLLVM.so"})
    assert (refused.returncode, refused.stdout) == (1, "")
    assert refused.stderr.startswith(
        "DRJIT_LIBLLVM_PATH=/missing/libLLVM.so: there is no such file"
    )
