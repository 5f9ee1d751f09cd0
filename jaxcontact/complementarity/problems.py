"""The problems: records that know their data and nothing of what is done with them.

Throughout, `0 <= z ⟂ w >= 0` means z >= 0, w >= 0 and z_i w_i = 0 for every i. Each record accepts leading batch
axes, the same on every array, so that `jax.vmap(solve, in_axes=(0, None))` may take it; `solve` itself takes one
problem. Integer and boolean data become the default float; half precision and complex numbers are refused.
"""

import warnings

import jax
import jax.numpy as jnp
import numpy as np

from jaxcontact.complementarity.records import record


@record
class LCP:
    """Linear complementarity problem: 0 <= z ⟂ w = M z + q >= 0 (Cottle, Pang, Stone, The LCP, 1.1).

    >>> LCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0])     # z = (4/3, 7/3)
    """

    M: jax.Array
    """(m, m); unit of w per unit of z."""
    q: jax.Array
    """(m,); unit of w."""

    def __post_init__(self):
        _check(self, "LCP", M=("m", "m"), q=("m",))


@record
class MLCP:
    """Mixed problem, u free: A u + C v + a = 0, 0 <= v ⟂ w = D u + B v + b >= 0.

    A solution stores u in `free`, v in `z`, w in `w`.

    >>> MLCP(A=[[2.0]], C=[[1.0]], a=[-1.0], D=[[1.0]], B=[[3.0]], b=[-2.0])
    """

    A: jax.Array
    """(k, k); may be singular (redundant equations)."""
    C: jax.Array
    """(k, m)."""
    a: jax.Array
    """(k,)."""
    D: jax.Array
    """(m, k)."""
    B: jax.Array
    """(m, m)."""
    b: jax.Array
    """(m,)."""

    def __post_init__(self):
        _check(self, "MLCP", A=("k", "k"), C=("k", "m"), a=("k",), D=("m", "k"), B=("m", "m"), b=("m",))


@record
class HorizontalLCP:
    """Horizontal problem: N w - M z = q, 0 <= z ⟂ w >= 0 (Cottle, Pang, Stone 1.5; tutorial (44)).

    >>> HorizontalLCP(N=jnp.eye(2), M=[[2.0, 1.0], [1.0, 2.0]], q=[-5.0, -6.0])     # N = I: the LCP
    """

    N: jax.Array
    """(m, m); unit of q per unit of w."""
    M: jax.Array
    """(m, m); unit of q per unit of z."""
    q: jax.Array
    """(m,)."""

    def __post_init__(self):
        _check(self, "HorizontalLCP", N=("m", "m"), M=("m", "m"), q=("m",))


@record
class AbsoluteValueEquation:
    """A x - B |x| + w = 0, the sliding law of bilateral contacts with B = At [mu xi] (tutorial, section 3.2).

    A solution stores x in `free`, its positive part in `z` and its negative part in `w`: x = z - w.

    >>> AbsoluteValueEquation(A=[[2.0]], B=[[1.0]], w=[-3.0])     # x = 3
    """

    A: jax.Array
    """(m, m)."""
    B: jax.Array
    """(m, m); unit of A."""
    w: jax.Array
    """(m,)."""

    def __post_init__(self):
        _check(self, "AbsoluteValueEquation", A=("m", "m"), B=("m", "m"), w=("m",))


@record
class BoxedLCP:
    """Boxed problem: lower <= x <= upper and, with w = M x + q, w_i >= 0 where x_i = lower_i, w_i <= 0 where
    x_i = upper_i, w_i = 0 between (the affine variational inequality over a box; Facchinei and Pang 2003, chapter 1).

    Bounds may be infinite, both of one x_i too, and equal: then x_i is given and w_i of any sign. Raises ValueError for
    NaN, lower > upper, lower = inf and upper = -inf. A solution stores x in `free`, z = (x - lower, b) and
    w = (a, upper - x), (2 m,) each, with M x + q = a - b; see `complementarity.boxed` for infinite and equal bounds.

    >>> BoxedLCP([[2.0]], [-5.0], lower=[0.0], upper=[1.0])     # x = 1, M x + q = -3
    """

    M: jax.Array
    """(m, m); unit of w per unit of x."""
    q: jax.Array
    """(m,); unit of w."""
    lower: jax.Array
    """(m,); unit of x."""
    upper: jax.Array
    """(m,); unit of x."""

    def __post_init__(self):
        _check(self, "BoxedLCP", M=("m", "m"), q=("m",), lower=("m",), upper=("m",))


Problem = LCP | MLCP | HorizontalLCP | AbsoluteValueEquation | BoxedLCP


def check_values(problem):
    """Raise ValueError on the first concrete number that cannot be meant: NaN, infinities, bounds that exclude each
    other. Nothing is said of traced numbers."""
    kind = type(problem).__name__
    for name, array in vars(problem).items():
        if not (kind == "BoxedLCP" and name in ("lower", "upper")):
            check_finite(f"{kind}.{name}", array)
    if isinstance(problem, BoxedLCP):
        _check_bounds(problem.lower, problem.upper)


def _check_bounds(lower, upper):
    """Raise on the first pair of concrete bounds between which there is no number."""
    if isinstance(lower, jax.core.Tracer) or isinstance(upper, jax.core.Tracer):
        return
    lower, upper = np.asarray(lower), np.asarray(upper)
    bad = np.argwhere(~((lower <= upper) & (lower < np.inf) & (upper > -np.inf)))
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        raise ValueError(
            f"BoxedLCP: lower{list(index)} is {lower[index]} and upper{list(index)} is {upper[index]}; "
            f"expected lower <= upper, lower < inf, upper > -inf"
        )


def _check(problem, kind, **axes):
    """Store the fields as arrays of one dtype; raise on shapes that do not belong together, and on NaN if eager."""
    arrays = {name: _as_float(f"{kind}.{name}", getattr(problem, name)) for name in axes}
    if len({array.dtype for array in arrays.values()}) > 1:
        raise TypeError(f"{kind}: one dtype for all arrays, got {_describe(arrays)}; cast them before building it")
    _check_shapes(kind, arrays, axes)
    for name, array in arrays.items():
        object.__setattr__(problem, name, array)
    if all(array.ndim == len(axes[name]) for name, array in arrays.items()):
        check_values(problem)


def _check_shapes(kind, arrays, axes):
    sizes, batches = {}, set()
    consistent = True
    for name, array in arrays.items():
        rank = len(axes[name])
        if array.ndim < rank:
            consistent = False
            continue
        batches.add(array.shape[: array.ndim - rank])
        for axis, size in zip(axes[name], array.shape[array.ndim - rank :], strict=True):
            consistent &= sizes.setdefault(axis, size) == size
    if not consistent or len(batches) > 1:
        expected = ", ".join(f"{name} ({', '.join(letters)})" for name, letters in axes.items())
        raise ValueError(
            f"{kind}: got {_describe(arrays)}; expected {expected}, with equal batch axes in front or none. "
            f"For one matrix and many vectors write jax.vmap over the vectors"
        )


def _as_float(name, value):
    """`value` as a float32 or float64 array; integers become the default float."""
    given = getattr(value, "dtype", None)
    array = value if isinstance(value, jax.Array) else jnp.asarray(value)
    if jnp.issubdtype(array.dtype, jnp.integer) or array.dtype == jnp.bool_:
        array = array.astype(jnp.result_type(float))
    if array.dtype not in (jnp.float32, jnp.float64):
        raise TypeError(
            f"{name} has dtype {array.dtype}; expected float32 or float64: write {name}.astype(jnp.float32)"
        )
    if given == np.float64 and array.dtype == jnp.float32:
        warnings.warn(
            f"{name} came in float64 and was rounded to float32, because JAX runs without x64; "
            f'write jax.config.update("jax_enable_x64", True) or pass float32',
            stacklevel=5,
        )
    return array


def check_finite(name, array):
    """Raise on the first NaN or infinity of a concrete array; say nothing of a traced one."""
    if isinstance(array, jax.core.Tracer):
        return
    bad = np.argwhere(~np.isfinite(np.asarray(array)))
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        raise ValueError(f"{name}{list(index)} is {array[index]}; expected finite numbers")


def _describe(arrays):
    return ", ".join(f"{name} {array.shape} {array.dtype}" for name, array in arrays.items())
