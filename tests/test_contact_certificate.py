"""Certificates of contact forces: they say what the exact threshold and the forces themselves say."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.bounds.classes import Verdict
from jaxcontact.mechanisms import LinearBearing, PainleveKlein

GUIDES = PainleveKlein(gravity=9.81)


def pulled(pull):
    return replace(GUIDES, lower_pull=pull)


@pytest.fixture(scope="module")
def certified():
    return jax.jit(jax.vmap(lambda pull, state, mu: jc.contact_forces(pulled(pull), state, mu, certified=True)))


def states(thetas):
    return jax.vmap(lambda theta: GUIDES.state(theta=theta, speed=1.3))(jnp.asarray(thetas))


def test_one_solution_is_certified_exactly_below_the_critical_friction(certified):
    thetas = np.linspace(0.2, 1.4, 8)
    here = states(thetas)
    threshold = jax.vmap(lambda state: jc.bounds.critical(jc.delassus(GUIDES, state)))(here)
    for factor, verdict in ((0.999, Verdict.YES), (1.001, Verdict.NO)):
        mu = factor * threshold[:, None] * jnp.ones((1, 2))
        found = certified(jnp.zeros(8), here, mu).certificate
        assert (found.uniqueness.verdict == verdict).all()
        assert np.isnan(np.asarray(found.error)).all() == (verdict == Verdict.NO)


def test_forces_move_with_the_load_no_faster_than_certified_and_the_error_is_rounding(certified):
    pulls = jnp.linspace(-20.0, 20.0, 8)
    here = states(np.full(8, 0.9))
    loads = np.asarray(jax.vmap(lambda pull, state: jc.delassus(pulled(pull), state).w)(pulls, here))
    forces = certified(pulls, here, jnp.full((8, 2), 0.2))
    assert (forces.status == jc.Status.SOLVED).all()
    normal = np.asarray(forces.normal)
    rate = np.linalg.norm(np.diff(normal, axis=0), axis=1) / np.linalg.norm(np.diff(loads, axis=0), axis=1)
    constant = np.asarray(forces.certificate.lipschitz)
    assert (rate <= constant[1:] * (1 + 1e-9)).all()  # rounding of the differences
    assert rate.max() > 0.05 * constant.max()
    error = np.asarray(forces.certificate.error)
    # a few roundings of the largest term, times the constant
    assert (error <= 64 * np.finfo(float).eps * constant * (abs(loads).max(1) + abs(normal).max(1) / constant)).all()


def test_it_is_attached_on_request_only_and_knows_its_size():
    state = GUIDES.state(theta=0.9, speed=1.0)
    assert jc.contact_forces(GUIDES, state, jnp.array([0.2, 0.2])).certificate is None
    bearing = LinearBearing()
    here = bearing.state(t=0.3)
    mu = jnp.full(len(bearing.contacts), 0.1)
    plain, more = (jc.contact_forces(bearing, here, mu, certified=c) for c in (False, True))
    np.testing.assert_allclose(plain.normal, more.normal, rtol=1e-14)
    assert int(more.certificate.uniqueness.verdict) == Verdict.YES
