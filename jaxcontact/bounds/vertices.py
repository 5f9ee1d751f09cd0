"""The vertices of a sliding problem: sets of closed contacts, with a sign of friction for each."""

import itertools
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from .. import linalg
from ..dynamics import Delassus, without_frictionless_bilateral
from ..dynamics.delassus import select_columns
from .coupling import coupling, dependent, square_factors
from .ratio import ratio_of
from .sign_real import Box, balanced, radius_in_box

MOST_VERTICES = 20_000
"""Vertices looked at without being asked to: 14 bilateral or 9 unilateral frictional contacts, some ms each."""

SLICED_SETS = 32
"""Up to this many sets of contacts are taken as slices, which XLA fuses; beyond, as one gather."""

CHUNK = 1024
"""Lanes whose roots are found together: the slowest holds up these only, and their state stays in the cache."""

CLOSE = 1e-3
"""The eigenvalue that the null vectors give replaces that of the root finder within this relative distance."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Reduced:
    """A sliding problem without its frictionless bilateral contacts, friction scaled by the ratio of coefficients."""

    N: Array
    """(n, m) whitened gap gradients."""
    T: Array
    """(n, m) whitened tangential directions times their ratio; zero columns where frictionless."""
    singular: Array
    """bool: the gaps depend on each other (all of them, the eliminated ones too)."""
    kept: tuple[int, ...] = field(metadata={"static": True})
    """Which of the user's contacts these are."""
    bilateral: tuple[int, ...] = field(metadata={"static": True})
    frictional: tuple[int, ...] = field(metadata={"static": True})

    @property
    def unilateral(self) -> tuple[int, ...]:
        return tuple(i for i in range(len(self.kept)) if i not in self.bilateral)

    def sets(self) -> list[tuple[int, ...]]:
        """b and every choice of unilateral contacts, where anything is frictional; the frictional ones come first."""
        chosen = [c for k in range(len(self.unilateral) + 1) for c in itertools.combinations(self.unilateral, k)]
        unions = [self.bilateral + c for c in chosen]
        ordered = [tuple(sorted(set(s), key=lambda i: (i not in self.frictional, i))) for s in unions]
        return [s for s in ordered if set(s) & set(self.frictional)]

    def roughs(self, members: tuple[int, ...]) -> int:
        """How many of `members`, a set of `sets()`, are frictional."""
        return sum(i in self.frictional for i in members)

    def vertices(self) -> int:
        """The number of determinants that decide."""
        return sum(2 ** self.roughs(members) for members in self.sets())

    def coupling_of(self, members: tuple[int, ...]) -> Array:
        """(k, k) X of the k frictional contacts among `members`, while these are closed."""
        k = self.roughs(members)
        X = coupling(select_columns(self.N, members), select_columns(self.T, members[:k]))
        return X[:k]


def reduced(operators: Delassus, ratio: Array | None) -> Reduced:
    """The problem that decides, for `ratio` as in `norm_ratio`; where the gaps are dependent, harmless numbers."""
    rates = ratio_of(operators.contacts, ratio, operators.N.dtype)
    rest = without_frictionless_bilateral(operators)
    kept = tuple(i for i, c in enumerate(operators.contacts) if c.frictional or not c.bilateral)
    T = rest.T * jnp.stack([rates[i] for i in kept])[None, :] if kept else rest.T
    singular = dependent(operators.N)
    N = rest.N
    if N.shape[0] >= N.shape[1]:
        N = jnp.where(singular, jnp.eye(*N.shape, dtype=N.dtype), N)
    return Reduced(N, T, singular, kept, rest.bilateral, rest.frictional)


def largest_vertex(problem: Reduced, xi: Array | None = None) -> tuple[Array, Array, Array]:
    """(lambda, closed (m,), S (m,)): the set and signs with the largest eigenvalue, of all vertices. No derivative.

    Each set is a box of D, |D| <= 1; with `xi` (m,) friction at unilateral contacts points one way, D in [0, xi].
    """
    N, T = square_factors(*jax.lax.stop_gradient((problem.N, problem.T)))
    m = len(problem.kept)
    found = []
    for size, rough in sorted({(len(s), problem.roughs(s)) for s in problem.sets()}):
        group = np.array([s for s in problem.sets() if (len(s), problem.roughs(s)) == (size, rough)])
        members = _columns(N, group), _columns(T, group[:, :rough]), _boxes(problem, group[:, :rough], xi, N.dtype)
        values, signs = jax.vmap(_set_radius)(*members)
        places = jnp.asarray(np.eye(m)[group[:, :rough]], N.dtype)
        closed = jnp.asarray(np.eye(m)[group].sum(axis=1), N.dtype)
        found.append((values, closed, jnp.sum(places * signs[:, :, None], axis=1)))
    values, closed, signs = (jnp.concatenate(parts) for parts in zip(*found))
    best = jnp.argmax(values)
    return values[best], closed[best], signs[best]


def _set_radius(N: Array, T: Array, box: Box) -> tuple[Array, Array]:
    return linalg.in_chunks(radius_in_box, CHUNK)(_balanced_coupling(N, T), box)


def _balanced_coupling(N: Array, T: Array) -> Array:
    # The barrier keeps XLA from fusing the stages into one program, which would take it minutes to compile.
    return balanced(lax.optimization_barrier(coupling(N, T)[: T.shape[1]]))


def at_vertex(problem: Reduced, value: Array, closed: Array, signs: Array) -> Array:
    """The eigenvalue of X S near `value` at one vertex, to full precision and differentiable."""
    N, T = square_factors(problem.N, problem.T)
    m = N.shape[1]
    if len(problem.bilateral) == len(problem.frictional) == m:
        # One set, whose coupling is known already: the signs do not matter to the balance.
        return eigenvalue_near(_balanced_coupling(N, T) * signs[None, :], value)
    open_rows = jnp.eye(m, dtype=N.dtype) * (1 - closed)[None, :]
    N = jnp.concatenate([N * closed[None, :], open_rows])
    T = jnp.concatenate([T * signs[None, :], jnp.zeros((m, m), T.dtype)])
    return eigenvalue_near(balanced(lax.optimization_barrier(coupling(N, T))), value)


@jax.custom_jvp
def eigenvalue_near(X: Array, guess: Array) -> Array:
    """The real eigenvalue of X (m, m) near a good guess: one step of Ostrowski's two-sided quotient u^T X v / u^T v."""
    return linalg.fused(_quotient, final=True)(X, guess)


def _quotient(X: Array, guess: Array) -> Array:
    u, _, v = linalg.singular_pair_min(guess * jnp.eye(X.shape[0], dtype=X.dtype) - X)
    overlap = jnp.sum(u * v)
    improved = jnp.sum(u * _apply(X, v)) / jnp.where(overlap == 0, 1, overlap)
    sound = (overlap != 0) & (abs(improved - guess) <= CLOSE * abs(guess))
    return jnp.where(sound, improved, guess)


@eigenvalue_near.defjvp
def _eigenvalue_near_jvp(primals, tangents):
    """d lambda = u^T dX v / u^T v. At the maximum over S no u_i v_i is negative, so a simple lambda has u^T v > 0."""
    (X, guess), (dX, _) = primals, tangents
    value = eigenvalue_near(X, guess)
    u, v, overlap = _null_vectors(X, value)
    change = jnp.sum(u * _apply(dX, v))
    return value, jnp.where(overlap == 0, 0, change / jnp.where(overlap == 0, 1, overlap))


def _null_vectors(X: Array, value: Array) -> tuple[Array, Array, Array]:
    U, _, V = linalg.decomposition(value * jnp.eye(X.shape[0], dtype=X.dtype) - X)
    u, v = U[:, -1], V[:, -1]
    return u, v, jnp.sum(u * v)


def _apply(X: Array, v: Array) -> Array:
    return jnp.matmul(X, v, precision=jax.lax.Precision.HIGHEST)


def _columns(X: Array, sets: np.ndarray) -> Array:
    """(sets, n, columns of each)."""
    if len(sets) <= SLICED_SETS:
        return jnp.stack([select_columns(X, tuple(s)) for s in sets])
    return jnp.moveaxis(X[:, sets], 0, 1)


def _boxes(problem: Reduced, sets: np.ndarray, xi: Array | None, dtype) -> Box:
    one = jnp.ones(sets.shape, dtype)
    if xi is None:
        return Box(one, -one)
    both = jnp.asarray(np.isin(sets, problem.bilateral))
    directed = jnp.stack([jnp.stack([xi[i] for i in s]) for s in sets])
    return Box(jnp.where(both, one, directed), jnp.where(both, -one, 0))
