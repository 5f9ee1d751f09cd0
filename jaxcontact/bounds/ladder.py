"""The rungs between the tutorial's bounds and the exact threshold, each tighter and dearer than the one before.

Bilateral contacts: norm_ratio <= operator_norm <= best_scaling <= critical, and perron <= best_scaling.
Any contacts: direct <= sharper_direct <= positive_definite_radius <= critical.

Frictionless bilateral contacts are eliminated first. Every rung is inf without friction, 0 where W is singular, and
NaN, with `.reason(operators)`, for contacts it is false for. X = W^-1 Wt diag(ratio) throughout.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from .. import linalg
from ..dynamics import Delassus
from ..dynamics.delassus import select_columns
from .coupling import coupling, orthogonal_triangular
from .critical import refuse_many, regular_shape, threshold, zero_radius
from .propositions import _all_bilateral, _any_contacts, proposition
from .scaling import scaled_norm
from .sign_real import balanced, radius_of_two
from .vertices import MOST_VERTICES, Reduced, eigenvalue_near, reduced


@proposition(_all_bilateral)
def operator_norm(operators: Delassus, ratio: Array) -> Array:
    """1 / |X|_2: below it I - r X S is regular for every signature S.

    Bilateral contacts only: for unilateral ones it is false (W = [[1, 9], [9, 100]], Wt = W [[0, 0], [1, 0]] has |X| =
    1 and loses uniqueness at 1/9). Cost: one factorisation, one norm. `operator_norm(delassus(guides, state))`
    """
    return _of_coupling(operators, ratio, linalg.singular_value_max)


@proposition(_all_bilateral)
def perron(operators: Delassus, ratio: Array) -> Array:
    """1 / rho(|X|), the Perron root of the absolute values: det(I - r X S) > 0 for every S since rho(X S) <= rho(|X|).

    Not comparable with `operator_norm`; independent of the scaling of rows; cost: the eigenvalues of one matrix.
    Bilateral contacts only, as `operator_norm`. `perron(delassus(guides, state))`
    """
    return _of_coupling(operators, ratio, lambda X: _perron_root(balanced(X)))


@proposition(_all_bilateral)
def best_scaling(operators: Delassus, ratio: Array) -> Array:
    """The supremum of 1 / |D^-1 X D|_2 over positive diagonal D: the best `operator_norm` over the units of the rows.

    Its logarithm is concave in log D. Up to two contacts it is `critical`, in closed form. Beyond, a path to the
    minimum and its multipliers (`scaling`): the value is that of one D, so a bound whatever happens, and close to the
    supremum (the tests ask for 1e-11 in nine of ten random systems, 1e-7 in all, in float64). Bilateral contacts only.
    Cost: some 30 Newton steps in m variables, more than `critical` (`python -m benchmarks ladder`). Derivative by the
    multipliers, which descent methods do not give, right where the largest singular value is repeated too, as it often
    is at the minimum; second derivatives as well.
    `best_scaling(delassus(guides, state))`
    """
    return _of_coupling(operators, ratio, lambda X: radius_of_two(X) if X.shape[0] <= 2 else scaled_norm(X))


@proposition(_any_contacts)
def sharper_direct(operators: Delassus, ratio: Array) -> Array:
    """1 / (|W^-1/2 Wt| |W^-1/2|) = sigma_min(N) / sigma_max(E^T T), N = E R: `direct` with one factor kept together.

    W - r Wt D is positive definite for |D| <= 1, so every vertex determinant is positive: bilateral, unilateral and
    mixed contacts. Cost: one factorisation, two norms. `sharper_direct(delassus(rod, state))`
    """
    problem = reduced(operators, ratio)
    if not problem.frictional or not regular_shape(problem):
        return threshold(problem, zero_radius(problem))
    E, _ = orthogonal_triangular(problem.N)
    felt = linalg.singular_value_max(linalg.gram(E, select_columns(problem.T, problem.frictional)))
    return threshold(problem, felt / linalg.singular_value_min(problem.N))


@proposition(_any_contacts)
def positive_definite_radius(operators: Delassus, ratio: Array) -> Array:
    """The largest r such that W - r Wt S is positive definite for every signature S.

    1 / max over S of the largest eigenvalue of sym(E^T T S R^-1), N = E R. A positive definite matrix is P, so it
    bounds `critical` for bilateral, unilateral and mixed contacts. Cost: 2^k symmetric eigenvalues for k frictional
    contacts. `positive_definite_radius(delassus(rod, state))`

    Raises:
        ValueError: for more signatures than `critical` takes by default.
    """
    refuse_many(operators, MOST_VERTICES, "positive_definite_radius")
    problem = reduced(operators, ratio)
    if not problem.frictional or not regular_shape(problem):
        return threshold(problem, zero_radius(problem))
    return threshold(problem, definite_radius(problem))


def definite_radius(problem: Reduced) -> Array:
    """max over S of the largest eigenvalue of sym(E^T T S R^-1)."""
    E, R = orthogonal_triangular(problem.N)
    Z = linalg.gram(E, problem.T)
    # Y^T = R^-T S Z^T is linear in S: one matrix for each frictional contact.
    inverse = linalg.solve_lower(R.T, jnp.eye(R.shape[0], dtype=R.dtype)).T
    parts = jnp.stack([Z[:, i][:, None] * inverse[i][None, :] for i in problem.frictional])
    parts = lax.optimization_barrier(0.5 * (parts + jnp.swapaxes(parts, 1, 2)))
    signs = jnp.asarray(np.array(list(itertools.product((1, -1), repeat=len(parts)))), R.dtype)
    every = jnp.einsum("sk,kij->sij", signs, parts, precision=lax.Precision.HIGHEST)
    return linalg.greatest(jax.vmap(linalg.symmetric_eigenvalue_max)(every))


def _of_coupling(operators: Delassus, ratio: Array, size) -> Array:
    """1 / size(X), X of the bilateral frictional contacts."""
    problem = reduced(operators, ratio)
    if not problem.frictional or not regular_shape(problem):
        return threshold(problem, zero_radius(problem))
    return threshold(problem, size(coupling(problem.N, problem.T)))


def _perron_root(X: Array) -> Array:
    """rho(|X|), polished by its null vectors."""
    X = abs(X)
    if X.shape[0] <= 2:
        return radius_of_two(X)
    rough = lax.stop_gradient(linalg.real_eigenvalue_max(X))
    present = rough > 0
    return jnp.where(present, eigenvalue_near(X, jnp.where(present, rough, 1)), 0 * rough)
