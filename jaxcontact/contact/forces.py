"""Forces and accelerations of a mechanism in sliding contact."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from .. import linalg
from ..complementarity import Direct, Lemke, Solution, Status, solve
from ..dynamics import Contact, Delassus, State, Terms, terms, whitened
from ..dynamics.numbers import is_concrete
from ..dynamics.sound import energy_of, refuse_unsound
from .certificate import Certificate, certificate
from .law import coefficients, stands_still
from .looked import Looked, looked_at
from .mass import is_definite, stiffened, stiffening
from .residuals import Residuals
from .sliding import Sliding, normal_forces, sliding, sort_contacts, with_sign
from .soundness import harmless, is_sound, without_idle_directions

ROUNDING = 1024
"""SOLVED requires every residual of the mechanics below ROUNDING (n + m) eps: 1e-12 in float64 for five unknowns."""

CLOSED_FORM = 2
"""Most contacts for which `Direct` misses no solution; up to four it takes, and is quicker than pivoting."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ContactForces:
    """Forces and accelerations, judged; under vmap every field carries the batch axes in front.

    Where the status is neither SOLVED nor REDUNDANT the numbers are NaN and have zero derivative.
    """

    normal: Array
    """(m,) normal forces lambda_n, N; positive pushes. If REDUNDANT: one of several (all frictionless and bilateral:
    the one of least norm)."""
    tangential: Array
    """(m,) friction forces -mu xi |lambda_n|, N; zero at frictionless contacts."""
    acceleration: Array
    """(n,) generalised accelerations, m/s^2 and rad/s^2."""
    status: Array
    """int32, a `jaxcontact.Status`."""
    residual: Array
    """The largest of `residuals`, no unit."""
    residuals: Residuals
    """Relative violations of dynamics, constraints, complementarity and Coulomb's law, from the mechanism's terms."""
    open: Array
    """(m,) bool: unilateral contacts that carry no force."""
    unique: Array
    """bool: certified by the direct bound, in units in which gradients have length 1, that no other forces solve the
    problem; False says nothing."""
    degenerate: Array
    """int32: contacts at a kink, with zero force and zero acceleration of the gap, or at a change of sign; derivatives
    there are one element of Clarke's generalised derivative."""
    steps: Array
    """int32: steps of the method; 0 where a linear solve was enough."""
    certificate: Certificate | None = None
    """How sure the forces are; on request."""

    @property
    def answered(self) -> Array:
        """bool: SOLVED or REDUNDANT."""
        return (self.status == int(Status.SOLVED)) | (self.status == int(Status.REDUNDANT))


def contact_forces(
    mechanism: Any, state: State, mu: Array | None = None, method: Any = None, *, certified: bool = False
) -> ContactForces:
    """What the contacts of `mechanism` exert at `state`, and how it accelerates.

    `contact_forces(guides, guides.state(theta=0.9, speed=1.0), jnp.array([0.2, 0.3])).normal`

    The contact kinds, static, choose the problem (`jaxcontact.contact.sliding`): a linear solve, an absolute value
    equation, an LCP or both. If there is no solution the answer is NaN with the reason; if there are several it is one
    of them. A contact with friction and no slip is STICKING. A singular mass matrix is accepted where the bilateral
    constraints determine the acceleration (Proposition 1(ii)); redundant bilateral constraints too.

    Args:
        mechanism, state: one state; batches through `jax.vmap`.
        mu: (m,) coefficients of friction in the order of the contacts; entries of frictionless contacts are ignored.
            None if nothing is frictional.
        method: of `jaxcontact.solve`; None chooses.
        certified: attach a `Certificate`, whose cost grows as 4^m: uniqueness with its margin, the Lipschitz constant
            of load -> forces, a guaranteed bound of the error. Static.

    Raises (shapes; values in eager calls only, in a trace they become BAD_INPUT):
        ValueError: mu of another shape, negative or not finite; a state off the constraints or not finite; a mass
            matrix that does not determine the acceleration.
        ValueError, also in a trace: `certified` with no contact or more than `bounds.classes.MOST_INDICES`.
        TypeError: the mechanism lacks a method or one returns a wrong shape; `method` is none.
    """
    if not isinstance(state, State) or not hasattr(mechanism, "contacts"):
        raise TypeError(f"expected a mechanism and its State, got {type(mechanism).__name__}, {type(state).__name__}")
    mu = coefficients(mechanism.contacts, mu, state.q.dtype)
    method = _cheapest(mechanism.contacts) if method is None else method
    if not is_concrete((mechanism, state, mu)):
        return _forces(mechanism, state, mu, method, certified)[0]
    forces, seen, energy = _forces_eagerly(mechanism, state, mu, method, certified)
    if int(forces.status) == Status.BAD_INPUT or any(map(float, energy)):
        refuse_unsound(mechanism, state, seen, energy)
        raise ValueError(f"{type(mechanism).__name__}: the numbers at this state overflow; choose other units")
    return forces


def _cheapest(contacts: tuple[Contact, ...]) -> Any:
    """One or two contacts with a law of their own in closed form, which misses no solution; more by pivoting."""
    return Direct() if len(sort_contacts(contacts).rest) <= CLOSED_FORM else Lemke()


_terms = jax.jit(terms)  # needed with and without derivatives, traced once


class Seen(NamedTuple):
    """What the door looks at; `L` only says whether the mass matrix is sound."""

    terms: Terms
    L: Array


@partial(jax.jit, static_argnames=("method", "certified"))
def _forces_eagerly(mechanism: Any, state: State, mu: Array, method: Any, certified: bool):
    """The forces, and for the door what is seen and what is wrong with the kinetic energy."""
    return *_forces(mechanism, state, mu, method, certified), energy_of(mechanism, state.q)


@partial(jax.jit, static_argnames=("method", "certified"))
def _forces(mechanism: Any, state: State, mu: Array, method: Any, certified: bool) -> tuple[ContactForces, Seen]:
    """The forces, and what the door looks at. Derivatives pass through lanes with sound input only."""
    contacts = mechanism.contacts
    seen, still, gamma, sound = _inspected(*lax.stop_gradient((mechanism, state, mu)))
    clear = sound & ~jnp.any(still & (mu > 0))
    mechanism, state, mu = _differentiable_where(clear, (mechanism, state, mu))
    prepared = linalg.fused_in_batches(_prepared)
    parts, friction, operators, found = prepared(mechanism, state, mu, still, clear, gamma)
    solution = None if found.problem is None else solve(found.problem, method)
    remaining = friction[:0] if solution is None else _of_the_rest(contacts, solution)
    left = found._replace(problem=None)
    normal, a, free = linalg.fused_in_batches(_accelerated)(operators, friction, left, remaining)
    looked = looked_at(parts, operators, free, friction, found, normal, a)
    reason = linalg.where(sound, int(Status.STICKING), int(Status.BAD_INPUT))
    status = linalg.where(clear, _status(looked, solution), reason)
    forces = _judged(contacts, friction, looked, solution, normal, a, status)
    if certified:
        signs = linalg.where(clear, jnp.sign(parts.slip), 0)
        forces = replace(forces, certificate=certificate(operators, linalg.where(clear, mu, 0), signs, forces.normal))
    return forces, seen


def _prepared(mechanism: Any, state: State, mu: Array, still: Array, clear: Array, gamma: Array):
    """(terms, mu xi, operators, sliding problem) where all is clear; else those of free unit masses."""
    contacts = mechanism.contacts
    parts = harmless(without_idle_directions(_terms(mechanism, state), still), clear)
    friction = linalg.where(clear, mu * jnp.sign(parts.slip), 0)
    operators = whitened(stiffened(parts, contacts, linalg.where(clear, gamma, 0)), contacts)
    return parts, friction, operators, sliding(operators, friction)


def _inspected(mechanism: Any, state: State, mu: Array) -> tuple[Seen, Array, Array, Array]:
    """(what is seen, contacts without slip (m,), stiffening of the mass matrix, whether all input is sound)."""
    contacts = mechanism.contacts

    def look(mechanism, state, mu):
        parts = _terms(mechanism, state)
        still = stands_still(contacts, parts, state)
        sound = is_sound(contacts, without_idle_directions(parts, still), state, mu)
        return still, sound, is_definite(parts.M)

    still, sound, regular = linalg.packed(look)(mechanism, state, mu)
    parts = without_idle_directions(linalg.fused_in_batches(_terms)(mechanism, state), still)
    zero = jnp.zeros((), state.q.dtype)
    gamma, massive = linalg.where_needed(~regular, lambda p: stiffening(p, contacts), (zero, regular), parts)
    seen = Seen(parts, linalg.where(massive, 1.0, jnp.nan))
    return seen, still, gamma, massive & sound


def _differentiable_where(clear: Array, tree: Any) -> Any:
    """The same values, without derivative where not clear: NaN partial derivatives of a bad lane end here."""
    return jax.tree.map(lambda x: linalg.where(clear, x, lax.stop_gradient(x)), tree)


def _of_the_rest(contacts: tuple[Contact, ...], solution: Solution) -> Array:
    """(r,) forces of the contacts with a law of their own, zero where the problem is not solved: NaN would reach the
    derivatives of other lanes."""
    return linalg.where(solution.answered, with_sign(contacts, solution.z, solution.w), 0)


def _accelerated(operators: Delassus, friction: Array, found: Sliding, remaining: Array):
    """Normal forces (m,), accelerations (n,) and free = L^-1 F (n,): L^T a = N lambda - D |lambda| - free."""
    free = linalg.solve_lower(operators.L, operators.terms.F)
    normal = normal_forces(operators, friction, found, remaining)
    pushes = operators.N * normal[None, :] - operators.T * (friction * lax.abs(normal))[None, :]
    return normal, linalg.solve_lower_transposed(operators.L, jnp.sum(pushes, axis=1) - free), free


def _status(looked: Looked, solution: Solution | None) -> Array:
    """The solver's word, overruled where linear constraints contradict each other or depend on one another."""
    status = jnp.int32(Status.SOLVED) if solution is None else solution.status
    answered = True if solution is None else solution.answered
    dependent = looked.deficient | (False if solution is None else solution.redundant)
    status = linalg.where(answered & dependent, int(Status.REDUNDANT), status)
    return linalg.where(looked.contradictory, int(Status.INFEASIBLE), status)


def _judged(contacts, friction, looked: Looked, solution, normal, a, status) -> ContactForces:
    """The record; where there is no answer, or the mechanics are not satisfied, NaN."""
    n, m, eps = len(a), len(normal), float(jnp.finfo(a.dtype).eps)
    largest = looked.misses.largest
    claimed = (status == int(Status.SOLVED)) | (status == int(Status.REDUNDANT))
    small = largest <= ROUNDING * (n + m) * eps
    status = linalg.where(claimed & ~small, int(Status.INACCURATE), status).astype(jnp.int32)
    answered = claimed & small

    def kept(x):
        return linalg.where(answered, x, jnp.nan)

    return ContactForces(
        normal=kept(normal),
        tangential=kept(-friction * lax.abs(normal)),
        acceleration=kept(a),
        status=status,
        residual=kept(largest),
        residuals=Residuals(*map(kept, looked.misses)),
        open=_open(contacts, solution) & answered,
        unique=looked.unique & ~looked.deficient & answered,
        degenerate=jnp.int32(0) if solution is None else linalg.where(answered, solution.degenerate, 0),
        steps=jnp.int32(0) if solution is None else solution.steps,
    )


def _open(contacts: tuple[Contact, ...], solution: Solution | None) -> Array:
    """(m,) bool: unilateral and without force."""
    rest = sort_contacts(contacts).rest
    places = {i: k for k, i in enumerate(rest)}
    closed = jnp.ones((), bool)
    flags = [closed if c.bilateral else solution.active[places[i]] for i, c in enumerate(contacts)]
    return ~jnp.stack(flags) if flags else jnp.zeros((0,), bool)
