"""The friction bound of a batch by other means: NumPy's batched LAPACK, Numba, C; the terms stated by hand.

Each is a function theta (count,) -> bound (count,) for the rod in one guide, the rod in two (Painlevé-Klein) or the
guided chain of `_chain.py`, all masses and lengths one. NumPy and C have every core; LAPACK on small matrices takes
one.
"""

import ctypes
import importlib.util
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from benchmarks._chain import chain_terms

SOURCE = Path(__file__).with_name("_bounds.c")

FLAGS = {"": [], " -ffast-math": ["-ffast-math"]}
"""Further flags of the compiler; the second allows gcc the vector sine and cosine of its library."""


def available(contacts, dtype):
    """{name with version: function}, of what is installed."""
    peers = {f"numpy {np.__version__} batched svd": lambda theta: by_numpy(theta, contacts)}
    if contacts <= 2 and importlib.util.find_spec("numba"):
        import numba

        peers[f"numba {numba.__version__} prange, closed form"] = _by_numba(contacts)
    return peers | _by_c(contacts, dtype)


def by_numpy(theta, contacts):
    """sigma_min(W) / sigma_max(Wt) by `np.linalg.svd` of the two stacks of matrices."""
    W, Wt = couplings(theta, contacts)
    return np.linalg.svd(W, compute_uv=False)[:, -1] / np.linalg.svd(Wt, compute_uv=False)[:, 0]


def couplings(theta, contacts):
    """W, Wt (count, m, m): written out for the rod, by Cholesky factor and substitution for the chain."""
    if contacts > 2:
        M, G, H = chain_terms(theta, contacts - 1)
        solved = np.linalg.solve(np.linalg.cholesky(M), np.concatenate([G, H], axis=2))
        N, T = solved[:, :, :contacts], solved[:, :, contacts:]
        return N.swapaxes(1, 2) @ N, N.swapaxes(1, 2) @ T
    s, c = np.sin(theta), np.cos(theta)
    square, product = 3 * c * c, 3 * s * c
    if contacts == 1:
        return (1 + square)[:, None, None], -product[:, None, None]
    W = np.stack([1 + square, 1 - square, 1 - square, 1 + square], axis=-1)
    Wt = np.stack([-product, product, product, -product], axis=-1)
    return W.reshape(-1, 2, 2), Wt.reshape(-1, 2, 2)


def _by_numba(contacts):
    import numba

    @numba.njit(inline="always")
    def top(a, b, c, d):
        p, q, r = a * a + c * c, b * b + d * d, a * b + c * d
        h = (p - q) / 2
        return np.sqrt((p + q) / 2 + np.sqrt(h * h + r * r))

    @numba.njit(parallel=True)
    def one(theta):
        found = np.empty_like(theta)
        for i in numba.prange(len(theta)):
            s, c = np.sin(theta[i]), np.cos(theta[i])
            found[i] = (1 + 3 * c * c) / abs(3 * s * c)
        return found

    @numba.njit(parallel=True)
    def two(theta):
        found = np.empty_like(theta)
        for i in numba.prange(len(theta)):
            s, c = np.sin(theta[i]), np.cos(theta[i])
            a, b, p = 1 + 3 * c * c, 1 - 3 * c * c, 3 * s * c
            found[i] = abs(a * a - b * b) / top(a, b, b, a) / top(-p, p, p, -p)
        return found

    return one if contacts == 1 else two


def _by_c(contacts, dtype):
    compiler = next(filter(None, map(shutil.which, ("gcc", "cc"))), None)
    if compiler is None:
        return {}
    version = subprocess.run([compiler, "-dumpfullversion"], capture_output=True, text=True).stdout.strip()
    loops = {}
    for extra, flags in FLAGS.items():
        loop = _compiled(compiler, contacts, dtype, flags)
        if loop is not None:
            loops[f"C loop, {Path(compiler).name} {version} -O3{extra}"] = loop
    return loops


def _compiled(compiler, contacts, dtype, flags):
    """The loop of `_bounds.c` on all cores, or None where the compiler refuses."""
    real = {"float64": "double", "float32": "float"}[np.dtype(dtype).name]
    with tempfile.TemporaryDirectory() as folder:
        library = os.path.join(folder, "bounds.so")
        command = [compiler, "-O3", "-march=native", "-fopenmp", "-fPIC", "-shared", *flags]
        command += [f"-DREAL={real}", f"-DCONTACTS={contacts}", str(SOURCE), "-o", library, "-lm"]
        if subprocess.run(command, capture_output=True).returncode:
            return None
        bounds = ctypes.CDLL(library).bounds
    pointer = np.ctypeslib.ndpointer(dtype, flags="C_CONTIGUOUS")
    bounds.argtypes, bounds.restype = [pointer, pointer, ctypes.c_long], None

    def loop(theta):
        found = np.empty_like(theta)
        bounds(theta, found, len(theta))
        return found

    return loop
