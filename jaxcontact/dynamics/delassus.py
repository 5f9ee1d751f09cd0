"""Delassus operators: what the contacts of a mechanism feel at a state, kept as whitened factors."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from .. import linalg
from .numbers import as_float_array, is_concrete
from .records import Contact, State
from .sound import energy_of, refuse_unsound
from .terms import Terms, terms


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Delassus:
    """What the contacts feel: W = N^T N and Wt = N^T T by their factors, and the free acceleration w.

    The gaps accelerate as W lambda_n + Wt lambda_t + w. Singular values are taken from the factors: forming W squares
    the condition number and, in float32, loses all digits where the contacts nearly depend on each other.

    The printed blocks are attributes (section 1.2 of the tutorial), in the user's order within each kind: A_nb, A_tb,
    A_nu, A_tu, A_nbnu, A_nbtu, A_nutb.
    """

    N: Array
    """(n, m) L^-1 G, whitened gradients of the gaps."""
    T: Array
    """(n, m) L^-1 H, whitened tangential directions; zero columns where frictionless."""
    w: Array
    """(m,) acceleration of the gaps without contact forces, -G^T M^-1 F + c, m/s^2."""
    L: Array | None
    """(n, n) Cholesky factor of the mass matrix; None if built from matrices."""
    terms: Terms | None
    """The terms it was made of; None if built from matrices."""
    contacts: tuple[Contact, ...] = field(metadata={"static": True})

    @property
    def bilateral(self) -> tuple[int, ...]:
        return tuple(i for i, contact in enumerate(self.contacts) if contact.bilateral)

    @property
    def unilateral(self) -> tuple[int, ...]:
        return tuple(i for i, contact in enumerate(self.contacts) if not contact.bilateral)

    @property
    def frictional(self) -> tuple[int, ...]:
        return tuple(i for i, contact in enumerate(self.contacts) if contact.frictional)

    @property
    def W(self) -> Array:
        """(m, m) normal-normal coupling of all contacts."""
        return linalg.gram(self.N, self.N)

    @property
    def Wt(self) -> Array:
        """(m, m) normal-tangential coupling of all contacts."""
        return linalg.gram(self.N, self.T)

    @property
    def A_nb(self) -> Array:
        """Normal bilateral / normal bilateral."""
        return self._block(self.N, self.bilateral, self.N, self.bilateral)

    @property
    def A_tb(self) -> Array:
        """Normal bilateral / tangential bilateral."""
        return self._block(self.N, self.bilateral, self.T, self.bilateral)

    @property
    def A_nu(self) -> Array:
        """Normal unilateral / normal unilateral."""
        return self._block(self.N, self.unilateral, self.N, self.unilateral)

    @property
    def A_tu(self) -> Array:
        """Normal unilateral / tangential unilateral."""
        return self._block(self.N, self.unilateral, self.T, self.unilateral)

    @property
    def A_nbnu(self) -> Array:
        """Normal bilateral / normal unilateral."""
        return self._block(self.N, self.bilateral, self.N, self.unilateral)

    @property
    def A_nbtu(self) -> Array:
        """Normal bilateral / tangential unilateral."""
        return self._block(self.N, self.bilateral, self.T, self.unilateral)

    @property
    def A_nutb(self) -> Array:
        """Normal unilateral / tangential bilateral. No transpose relation ties it to A_nbtu."""
        return self._block(self.N, self.unilateral, self.T, self.bilateral)

    @staticmethod
    def _block(left: Array, rows: tuple[int, ...], right: Array, columns: tuple[int, ...]) -> Array:
        return linalg.gram(select_columns(left, rows), select_columns(right, columns))


def delassus(mechanism: Any, state: State) -> Delassus:
    """What the contacts of `mechanism` feel at `state`.

    `delassus(guides, guides.state(theta=0.9)).A_nb`

    Works for one state; batches through `jax.vmap`. Called with plain values it is checked; inside a trace nothing can
    be raised, and a mass matrix that is not positive definite, or only up to rounding, makes every entry NaN.

    Raises (eager calls only, but for the shapes):
        ValueError: if a value is NaN, the kinetic energy is no quadratic form of the velocities, the mass matrix is not
            positive definite, the state leaves a gap or a bilateral constraint open, or a slip direction is undefined
            at rest.
        TypeError: if the mechanism lacks a method or one of them returns a wrong shape.
    """
    if is_concrete((mechanism, state)):
        operators, energy = _assemble_eagerly(mechanism, state)
        refuse_unsound(mechanism, state, operators, energy)
        return operators
    return assemble(mechanism, state)


@partial(jax.jit, inline=True)
def assemble(mechanism: Any, state: State) -> Delassus:
    """`delassus` without the checks of its door; one compiled program also when it is differentiated eagerly."""
    return linalg.fused_in_batches(lambda g, s: whitened(terms(g, s), g.contacts))(mechanism, state)


def delassus_from_matrices(W: Array, Wt: Array, w: Array | None = None, *, contacts: tuple[Contact, ...]) -> Delassus:
    """Delassus operators from the matrices themselves, for those who have no mechanism but W = G^T M^-1 G and Wt = G^T
    M^-1 H.

    `delassus_from_matrices(W, Wt, contacts=(jc.Contact("a", "bilateral", True), jc.Contact("b", "bilateral", True)))`

    Args:
        W: (m, m) symmetric positive definite. Wt: (m, m); columns of frictionless contacts are ignored. w: (m,), zeros
        if None.

    A singular W gives NaN factors: from the matrix alone its rank cannot be told from rounding.

    Raises:
        ValueError: if the shapes do not fit the number of contacts.
    """
    m = len(contacts)
    W, Wt = as_float_array("W", W), as_float_array("Wt", Wt)
    w = jnp.zeros((m,), W.dtype) if w is None else as_float_array("w", w)
    for name, value, shape in (("W", W, (m, m)), ("Wt", Wt, (m, m)), ("w", w, (m,))):
        if value.shape != shape:
            raise ValueError(f"{name} must have shape {shape} for {m} contacts, got {value.shape}")
    rough = jnp.array([contact.frictional for contact in contacts], bool)
    R = linalg.cholesky(W)
    T = linalg.solve_lower(R, linalg.where(rough[None, :], Wt, 0.0))
    return Delassus(N=R.T, T=T, w=w, L=None, terms=None, contacts=tuple(contacts))


def select_columns(X: Array, indices: Sequence[int]) -> Array:
    """Columns of X by static indices, as slices: an index array would become a gather, which XLA does not fuse."""
    if not indices:
        return X[:, :0]
    return jnp.stack([X[:, i] for i in indices], axis=1)


def select(x: Array, indices: Sequence[int]) -> Array:
    """Entries of a vector by static indices."""
    return jnp.stack([x[i] for i in indices]) if indices else x[:0]


def whitened(parts: Terms, contacts: tuple[Contact, ...]) -> Delassus:
    """The operators of given terms: L L^T = M, N = L^-1 G, T = L^-1 H, w = c - N^T L^-1 F.

    `whitened(terms(guides, state), guides.contacts)`
    """
    L = _factor(parts.M)
    N, T = linalg.solve_lower(L, parts.G), linalg.solve_lower(L, parts.H)
    free = linalg.solve_lower(L, parts.F)
    w = parts.c - linalg.gram(N, free[:, None])[:, 0]
    return Delassus(N=N, T=T, w=w, L=L, terms=parts, contacts=tuple(contacts))


def _factor(M: Array) -> Array:
    """L with L L^T = M; NaN where M overflows or a pivot is rounding, so that some mass is lost in the others."""
    n = M.shape[0]
    L = linalg.cholesky(M)
    if n == 0:
        return L
    diagonal = jnp.stack([M[i, i] for i in range(n)])
    noise = n * float(jnp.finfo(M.dtype).eps)
    sound = jnp.stack([L[i, i] ** 2 > noise * diagonal[i] for i in range(n)]).all() & (jnp.sum(diagonal) < jnp.inf)
    return linalg.where(sound, L, jnp.nan)


@jax.jit
def _assemble_eagerly(mechanism, state):
    """The operators and, for the door, what is wrong with the kinetic energy."""
    return assemble(mechanism, state), energy_of(mechanism, state.q)
