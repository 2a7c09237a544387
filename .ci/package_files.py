"""Check what the wheel and the sdist in a folder hold, against what git tracks."""

import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path


def tracked(*paths: str) -> set[str]:
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "-z", "--", *paths],
        capture_output=True,
        text=True,
        check=True,
    )
    return {name for name in listed.stdout.split("\0") if name and Path(name).exists()}


def compare(what: str, has: set[str], expected: set[str]) -> None:
    """End the program if some files are missing, or there are others."""
    wrong = [f"{what}: lacks {name}" for name in sorted(expected - has)]
    wrong += [f"{what}: should not have {name}" for name in sorted(has - expected)]
    if wrong:
        sys.exit("\n".join(wrong))
    print(f"{what}: {len(has)} files, as it should be")


def main() -> None:
    folder = Path(sys.argv[1])
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        licenses = {name for name in archive.namelist() if name.endswith("/licenses/LICENSE")}
    scenes = {f"whitted/{name}" for name in tracked("scenes")}
    compare("wheel", names | licenses, tracked("whitted") | scenes | licenses)
    if not licenses:
        sys.exit("wheel: lacks its licence")
    with tarfile.open(sdist) as archive:
        names = {member.name.split("/", 1)[1] for member in archive if member.isfile()}
    compare("sdist", names, tracked() | {"PKG-INFO"})


if __name__ == "__main__":
    main()
