"""Terms as whitened operators."""

from .. import linalg
from ..dynamics import Contact, Delassus, Terms


def whitened(parts: Terms, contacts: tuple[Contact, ...]) -> Delassus:
    """`Delassus` of given terms: L L^T = M, N = L^-1 G, T = L^-1 H, w = c - N^T L^-1 F."""
    L = linalg.cholesky(parts.M)
    N, T = linalg.solve_lower(L, parts.G), linalg.solve_lower(L, parts.H)
    w = parts.c - linalg.gram(N, linalg.solve_lower(L, parts.F))
    return Delassus(N=N, T=T, w=w, L=L, terms=parts, contacts=tuple(contacts))
