"""The switches every test runs under: the library itself sets none."""

import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

LONG = {
    "test_contact_random.py::test_gauss_principle_of_least_constraint[u u u]",
    "test_contact_random.py::test_what_is_answered_is_a_solution[three to pivot]",
    "test_complementarity_boxed.py::test_a_bad_lane_keeps_its_nan_and_infinite_bounds_have_a_finite_derivative",
    "test_complementarity_boxed.py::test_the_stored_problem_has_its_exact_answer[float32]",
    "test_complementarity_principal.py::test_a_warm_start_at_the_answer_needs_only_its_own_pivots_and_a_wrong_one_does_no_harm",
    "test_critical.py::test_second_derivatives_follow_the_closed_form_and_the_difference_of_gradients",
    "test_critical_variants.py::test_a_bracket_of_twenty_contacts_has_a_witness_within_a_factor_of_the_lower_bound",
    "test_documents.py::test_notebooks_run[critical_friction]",
    "test_documents.py::test_notebooks_run[extremes]",
    "test_extremes.py::test_a_hundred_contacts_are_solved_and_what_looks_at_every_vertex_says_that_it_cannot",
    "test_extremes.py::test_one_support_counted_four_times_carries_the_load_once_whatever_ties",
    "test_extremes.py::test_tiny_and_huge_units_change_no_threshold_no_count_and_no_force[float32]",
    "test_invariance.py::test_grams_for_kilograms_change_proposition_14_alone",
    "test_ladder.py::test_derivatives_of_every_bound_at_two_hundred_points_of_every_mechanism[ArticulatedPainleveKlein]",
    "test_ladder.py::test_derivatives_of_every_bound_at_two_hundred_points_of_every_mechanism[FlexiblePainleveKlein]",
    "test_ladder.py::test_derivatives_of_every_bound_at_two_hundred_points_of_every_mechanism[LinearBearing]",
    "test_ladder.py::test_derivatives_of_every_bound_at_two_hundred_points_of_every_mechanism[RodBetweenFloorAndCeiling]",
    "test_ladder.py::test_derivatives_of_the_rungs_at_two_hundred_random_systems[bbb]",
    "test_ladder.py::test_every_rung_is_below_the_next_on_ten_thousand_random_systems[bbb-names0-float32]",
    "test_ladder.py::test_every_rung_is_below_the_next_on_ten_thousand_random_systems[uuu-names1-float32]",
    "test_ladder.py::test_scaling_away_what_no_cycle_joins",
    "test_ladder.py::test_second_derivatives_of_the_scaled_norm_follow_differences_of_the_first",
}
"""Tests that compile for twenty seconds and more, and have shorter siblings: they run with the slow ones."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark the long tests as slow."""
    for item in items:
        if item.nodeid.removeprefix("tests/") in LONG:
            item.add_marker(pytest.mark.slow)
