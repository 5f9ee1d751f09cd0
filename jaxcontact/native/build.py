"""Building the kernels: one call of the system's C++ compiler, for this very machine.

`pip install` does it where a compiler and jaxlib's headers are at hand, `jaxcontact kernels --build` does it later.
Imports nothing of this package, so that the build of a wheel can load this file from its path.
"""

import hashlib
import os
import platform
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

SOURCES = Path(__file__).parent / "src"

FLAGS = (
    "-std=c++17",
    "-O3",
    "-mprefer-vector-width=512",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fPIC",
)
"""Nothing that reorders sums or forgets NaN."""


REALS = ("double", "float")


class CannotBuild(Exception):
    """Why there are no kernels; everything works without them, more slowly."""


def library() -> Path:
    """Where the kernels of these sources for this processor are, or would be."""
    return Path(__file__).parent / f"_kernels_{_fingerprint()}.so"


def build() -> Path:
    """Compile the kernels beside this file and return their path.

    Raises `CannotBuild` without a compiler (CXX, c++, g++ or clang++), without jaxlib's headers, or with its message
    where the compiler fails.

    >>> build()     # .../jaxcontact/native/_kernels_1f0c....so
    """
    compiler = next(filter(None, map(shutil.which, (os.environ.get("CXX", ""), "c++", "g++", "clang++"))), None)
    if compiler is None:
        raise CannotBuild("no C++ compiler found: install one, or name it in CXX")
    target = library()
    try:
        with TemporaryDirectory(dir=target.parent, prefix="_kernels_") as folder:
            objects = _compiled(compiler, Path(folder))
            link = _start([compiler, "-shared", *map(str, objects), "-o", str(Path(folder) / target.name)])
            _check(link, link.communicate()[0])
            (Path(folder) / target.name).replace(target)
    except OSError as error:
        raise CannotBuild(f"{compiler} or {target.parent}: {error}") from error
    for old in set(target.parent.glob("_kernels_*.so")) - {target}:
        old.unlink(missing_ok=True)
    return target


def _compiled(compiler: str, folder: Path) -> list[Path]:
    """The object files, one for each kind of number, made at the same time."""
    common = [compiler, *FLAGS, "-march=native", f"-I{_headers()}", "-c", str(SOURCES / "kernels.cpp")]
    objects = [folder / f"{real}.o" for real in REALS]
    runs = [
        _start([*common, f"-DJAXCONTACT_REAL={real}", "-o", str(o)]) for real, o in zip(REALS, objects, strict=True)
    ]
    outputs = [run.communicate()[0] for run in runs]
    for run, output in zip(runs, outputs, strict=True):
        _check(run, output)
    return objects


def _start(command: list[str]) -> subprocess.Popen:
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def _check(run: subprocess.Popen, output: str) -> None:
    if run.returncode:
        raise CannotBuild(f"{run.args[0]} failed:\n{output[-2000:]}")


def _headers() -> Path:
    """jaxlib's folder of headers for foreign functions."""
    found = find_spec("jaxlib")
    headers = Path(found.origin).parent / "include" if found and found.origin else None
    if headers is None or not (headers / "xla" / "ffi" / "api" / "ffi.h").exists():
        raise CannotBuild("the headers of jaxlib (xla/ffi/api/ffi.h) are not here")
    return headers


def _fingerprint() -> str:
    """Of sources, flags and processor: a library for others is not loaded."""
    found = hashlib.sha256("\n".join([_processor(), *FLAGS]).encode())
    for source in sorted(SOURCES.iterdir()):
        found.update(source.read_bytes())
    return found.hexdigest()[:16]


def _processor() -> str:
    """What the processor is and can do."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    abilities = sorted({line for line in lines if line.startswith(("flags", "Features", "isa"))})
    return "\n".join([platform.system(), platform.machine(), *(abilities or [platform.processor()])])
