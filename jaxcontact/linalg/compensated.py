"""Sums, products and small determinants whose rounding error is carried along.

Error-free transformations: Ogita, Rump & Oishi, "Accurate sum and dot product", SIAM J. Sci. Comput. 26 (2005),
algorithms 3.1 to 3.3 (Knuth's two-sum, Dekker's two-product). XLA neither reorders float sums nor widens them; what it
may do is contract a product with a following sum into one fused instruction. The split below therefore masks bits
instead of using Veltkamp's multiply-and-subtract, so that every partial product is exact with or without contraction.
"""

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg.tracing import traced_once

Scalar = jax.Array


def _split(a: Scalar) -> tuple[Scalar, Scalar]:
    """a = high + low exactly, high rounded to half the significant bits: then all products of halves are exact."""
    info = jnp.finfo(a.dtype)
    word = jnp.dtype(f"uint{info.bits}")
    dropped = (info.nmant + 2) // 2
    half_unit = jnp.array(1 << (dropped - 1), word)
    mask = jnp.array(((1 << info.bits) - 1) ^ ((1 << dropped) - 1), word)
    high = lax.bitcast_convert_type((lax.bitcast_convert_type(a, word) + half_unit) & mask, a.dtype)
    return high, a - high


@traced_once
def two_sum(a: Scalar, b: Scalar) -> tuple[Scalar, Scalar]:
    """(s, e) with s = fl(a + b) and s + e = a + b exactly. Scalars or arrays of one shape and dtype.

    >>> two_sum(jnp.float32(1.0), jnp.float32(1e-10))  # (1.0, 1e-10)
    """
    return _two_sum(a, b)


@jax.custom_jvp
def _two_sum(a, b):
    s = a + b
    b_seen = s - a
    return s, (a - (s - b_seen)) + (b - b_seen)


@_two_sum.defjvp
def _two_sum_jvp(primals, tangents):
    """The exact sum is s + e: all of its derivative is given to s, none to the rounding error."""
    s, e = _two_sum(*primals)
    return (s, e), (tangents[0] + tangents[1], jnp.zeros_like(e))


@traced_once
def two_product(a: Scalar, b: Scalar) -> tuple[Scalar, Scalar]:
    """(p, e) with p = fl(a b) and p + e = a b to twice the working precision (no overflow, no underflow of e).

    >>> two_product(jnp.float32(1 / 3), jnp.float32(3.0))
    """
    return _two_product(a, b)


@jax.custom_jvp
def _two_product(a, b):
    p = a * b
    a_high, a_low = _split(a)
    b_high, b_low = _split(b)
    return p, (((a_high * b_high - p) + a_high * b_low) + a_low * b_high) + a_low * b_low


@_two_product.defjvp
def _two_product_jvp(primals, tangents):
    """As for the sum: the derivative of a b belongs to p."""
    (a, b), (da, db) = primals, tangents
    p, e = _two_product(a, b)
    return (p, e), (da * b + a * db, jnp.zeros_like(e))


@traced_once
def det2_pair(a: Scalar, b: Scalar, c: Scalar, d: Scalar) -> tuple[Scalar, Scalar]:
    """a d - b c as an unevaluated sum (high, low), right to about twice the working precision even after cancellation.

    The four terms p1 - p2 + e1 - e2 are the exact value; they are summed without losing what the cancellation uncovers.
    """
    p1, e1 = two_product(a, d)
    p2, e2 = two_product(b, c)
    s, s_error = two_sum(p1, -p2)
    t, t_error = two_sum(e1, -e2)
    t, rest = two_sum(s_error, t)
    high, low = two_sum(s, t)
    return two_sum(high, low + (rest + t_error))


@traced_once
def det2(a: Scalar, b: Scalar, c: Scalar, d: Scalar) -> Scalar:
    """a d - b c, the determinant of [[a, b], [c, d]], to the last digit or two whatever cancels.

    >>> det2(jnp.float64(1), jnp.float64(1), jnp.float64(1), jnp.float64(1 + 2.0**-30))  # 2**-30
    """
    p1, e1 = two_product(a, d)
    p2, e2 = two_product(b, c)
    s, s_error = two_sum(p1, -p2)
    return s + (s_error + (e1 - e2))


def dot_pairs(a: list[Scalar], pairs: list[tuple[Scalar, Scalar]]) -> Scalar:
    """Sum of a_i (high_i + low_i), accumulated in twice the working precision."""
    total = error = jnp.zeros_like(a[0])
    for a_i, (high, low) in zip(a, pairs, strict=True):
        p, e = two_product(a_i, high)
        total, e_sum = two_sum(total, p)
        error = error + (e + e_sum + a_i * low)
    return total + error


def dot(a: list[Scalar], b: list[Scalar]) -> Scalar:
    """Sum of a_i b_i as if computed in twice the working precision (Ogita, Rump & Oishi, algorithm 5.3, Dot2)."""
    return dot_pairs(a, [(b_i, jnp.zeros_like(b_i)) for b_i in b])


def cofactor_pairs3(A: list[list[Scalar]]) -> list[list[tuple[Scalar, Scalar]]]:
    """Cofactors of a 3 by 3 nested list, each as a pair (high, low)."""

    def cofactor(i: int, j: int) -> tuple[Scalar, Scalar]:
        r, s = (i + 1) % 3, (i + 2) % 3
        c, d = (j + 1) % 3, (j + 2) % 3
        return det2_pair(A[r][c], A[r][d], A[s][c], A[s][d])

    return [[cofactor(i, j) for j in range(3)] for i in range(3)]


def det3(A: list[list[Scalar]]) -> Scalar:
    """Determinant of a 3 by 3 nested list to the last digits: relative error about eps + eps^2 cond(A)."""
    return dot_pairs(A[0], cofactor_pairs3(A)[0])
