"""The diagonal scaling that makes the norm of a matrix smallest."""

import jax
import jax.numpy as jnp
from jax import Array, lax

from .. import linalg
from .sign_real import balanced

SQUARINGS = {4: 7, 8: 14}
"""By bytes of the dtype: the smoothed norm is the Schatten norm of order 2^(1 + squarings), above by m^(1/order)."""

STEPS = 2
"""Newton steps for each order of the smoothed norm; doubling the order moves the minimum a little."""

RIDGE = 1e-6
"""Added to the Hessian, whose natural size is one: it bounds the steps where the smoothed norm is flat."""

LAST_STEPS = 8
"""More steps at the last order: the derivative is right as far as the gradient there vanishes."""

LONGEST = 1.0
"""Longest change of any log D in one step."""


def scaled_norm(X: Array) -> Array:
    """The smallest |D^-1 X D|_2 over positive diagonal D, for X (m, m); an upper bound of it by the D that is found.

    log |D^-1 X D| is convex in log D (mathematics 3(c)). At the minimum the largest singular value may be repeated, so
    smooth norms of doubling order are minimised one after the other. The derivative is that of the smoothed norm at
    fixed D: with repeated singular values it weighs them as the minimum does (envelope theorem).

    `scaled_norm(jnp.array([[0.0, 100.0], [0.01, 0.0]]))` is 1.
    """
    X = balanced(X)
    t = _best_log_scale(lax.stop_gradient(X))
    starts = jnp.stack([jnp.zeros_like(t), t])
    norms = jnp.stack([linalg.singular_value_max(_scaled(lax.stop_gradient(X), s)) for s in starts])
    best = jnp.where(norms[1] < norms[0], t, jnp.zeros_like(t))
    Y = _scaled(X, best)
    size = lax.stop_gradient(jnp.max(abs(Y)))
    nothing = size == 0
    smooth = _log_norm(Y / jnp.where(nothing, 1, size), SQUARINGS[X.dtype.itemsize], nothing)
    return jnp.min(lax.stop_gradient(norms)) * jnp.exp(smooth - lax.stop_gradient(smooth))


def _scaled(X: Array, t: Array) -> Array:
    """D^-1 X D for D = exp(t)."""
    return X * jnp.exp(t[None, :] - t[:, None])


def _log_norm(Y: Array, squarings: int | Array, nothing: Array) -> Array:
    """log of the Schatten norm of order 2^(1 + squarings): (tr (Y^T Y)^p)^(1 / 2p), p = 2^squarings, by squaring."""
    G = jnp.matmul(Y.T, Y, precision=lax.Precision.HIGHEST)
    G = jnp.where(nothing, jnp.eye(Y.shape[0], dtype=Y.dtype), G)
    trace = jnp.trace(G)

    def squared(_, state):
        G, log_size, share = state
        G = jnp.matmul(G, G, precision=lax.Precision.HIGHEST)
        trace = jnp.trace(G)
        return G / trace, log_size + 0.5 * share * jnp.log(trace), 0.5 * share

    state = G / trace, 0.5 * jnp.log(trace), 0.5 * jnp.ones_like(trace)
    if isinstance(squarings, int):
        for k in range(squarings):
            state = squared(k, state)
        return state[1]
    return lax.fori_loop(0, squarings, squared, state)[1]


def _best_log_scale(X: Array) -> Array:
    """log D of the minimum: Newton's method on the smoothed norms, order by order."""
    m = X.shape[0]
    size = jnp.max(abs(X))
    nothing = ~((size > 0) & (size < jnp.inf))
    X = jnp.where(nothing, jnp.eye(m, dtype=X.dtype), X / jnp.where(nothing, 1, size))

    last = SQUARINGS[X.dtype.itemsize]

    def improved(step, t):
        def f(t):
            return _log_norm(_scaled(X, t), jnp.minimum(step // STEPS + 1, last), nothing)

        gradient = jax.jacfwd(f)
        # f does not change along (1, ..., 1); the mean curvature there is set to one.
        H = jax.jacfwd(gradient)(t) + jnp.full((m, m), 1 / m, X.dtype) + RIDGE * jnp.eye(m, dtype=X.dtype)
        change = -jnp.linalg.solve(H, gradient(t))
        change = change * jnp.minimum(1, LONGEST / jnp.maximum(jnp.max(abs(change)), LONGEST))
        trials = jnp.stack([t, t + 0.1 * change, t + 0.4 * change, t + change])
        values = jax.vmap(f)(trials)
        return trials[jnp.argmin(jnp.where(jnp.isnan(values), jnp.inf, values))]

    return lax.fori_loop(0, STEPS * last + LAST_STEPS, improved, jnp.zeros(m, X.dtype))
