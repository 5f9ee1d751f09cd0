"""The benchmark of the bounds: the terms stated by hand are those of the mechanisms, and four contacts are one loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from benchmarks import bounds
from benchmarks._bounds_peers import couplings


@pytest.mark.parametrize("contacts", [1, 2, 4])
def test_the_terms_stated_by_hand_are_those_of_the_mechanism(contacts):
    guides, theta = bounds.mechanism(contacts), np.array([0.2, 0.7, 1.3])
    here = jax.vmap(lambda x: jc.delassus(guides, guides.state(theta=x)))(theta)
    for product, stated in zip((here.N, here.T), couplings(theta, contacts), strict=True):
        derived = np.swapaxes(here.N, 1, 2) @ product
        np.testing.assert_allclose(derived, stated, rtol=0, atol=1e-13 * np.abs(stated).max())


def test_the_bound_of_four_contacts_is_one_loop_without_library_calls():
    """Two would be 10 times slower, LAPACK 40 times."""
    bound = jax.jit(jax.vmap(bounds.programs(4)[bounds.BASE]))
    program = bound.lower(jnp.linspace(0.1, 1.4, 1000)).compile().as_text()
    assert program.count(" fusion(") <= 1
    assert "custom-call" not in program


def test_a_wrong_bound_and_a_wrong_slope_are_refused():
    theta = np.linspace(0.1, 1.4, 50)
    expected = bounds.by_numpy(theta, 2)
    bounds.refuse_disagreement(2, theta, {"norm_ratio": expected})
    with pytest.raises(ValueError, match="1 lanes off"):
        bounds.refuse_disagreement(2, theta, {"norm_ratio": expected + 1e-6 * (theta == theta[7])})
    with pytest.raises(ValueError, match="slopes"):
        bounds.refuse_disagreement(2, theta, {"norm_ratio, jvp": (expected, np.zeros(50))})
