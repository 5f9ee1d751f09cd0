"""Small dense linear algebra that batches: factors, solves, singular values."""

from jaxcontact.linalg.batches import compiler_options, for_the_few, in_chunks, walled, where_needed
from jaxcontact.linalg.compensated import det2, det3, dot, two_product, two_sum
from jaxcontact.linalg.decomposition import decomposition
from jaxcontact.linalg.extrema import all_finite, greatest, least
from jaxcontact.linalg.factors import (
    cholesky,
    det,
    gram,
    project_out,
    solve,
    solve_lower,
    solve_lower_transposed,
)
from jaxcontact.linalg.fused import as_one, from_one, fused
from jaxcontact.linalg.jacobi import singular_values_jacobi
from jaxcontact.linalg.lanes import fused_in_batches
from jaxcontact.linalg.packed import packed
from jaxcontact.linalg.singular import (
    singular_pair_max,
    singular_pair_min,
    singular_value_max,
    singular_value_min,
)
from jaxcontact.linalg.spectrum import real_eigenvalue_max
from jaxcontact.linalg.symmetric import symmetric_eigenvalue_max, symmetric_eigenvalue_min
from jaxcontact.linalg.tracing import where
from jaxcontact.linalg.unrolled import diagonal, shield

__all__ = [
    "all_finite",
    "as_one",
    "cholesky",
    "compiler_options",
    "decomposition",
    "det",
    "det2",
    "det3",
    "diagonal",
    "dot",
    "for_the_few",
    "from_one",
    "fused",
    "fused_in_batches",
    "gram",
    "greatest",
    "in_chunks",
    "least",
    "packed",
    "project_out",
    "real_eigenvalue_max",
    "shield",
    "singular_pair_max",
    "singular_pair_min",
    "singular_value_max",
    "singular_value_min",
    "singular_values_jacobi",
    "solve",
    "solve_lower",
    "solve_lower_transposed",
    "symmetric_eigenvalue_max",
    "symmetric_eigenvalue_min",
    "two_product",
    "two_sum",
    "walled",
    "where",
    "where_needed",
]
