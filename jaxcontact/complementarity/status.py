"""How a solve ended: a named integer, a sentence, and what one can do about it."""

from enum import IntEnum


class Status(IntEnum):
    """Outcome of one problem. It travels as an int32 through jit and vmap; `Status(int(x))` gives the name back.

    >>> Status.RAY.sentence, Status.RAY.remedy
    """

    SOLVED = 0
    RAY = 1
    INFEASIBLE = 2
    MAX_STEPS = 3
    INACCURATE = 4
    BAD_INPUT = 5
    REDUNDANT = 6
    STICKING = 7
    ILL_CONDITIONED = 8
    NO_SOLUTION = 9

    @property
    def sentence(self) -> str:
        """What happened."""
        return _TEXTS[self][0]

    @property
    def remedy(self) -> str:
        """What to try next."""
        return _TEXTS[self][1]


_TEXTS = {
    Status.SOLVED: (
        "The answer satisfies the problem up to rounding; nothing is said about other answers.",
        "Nothing to do. Ask for all solutions if uniqueness matters.",
    ),
    Status.RAY: (
        "Lemke's path left along a ray: the method cannot tell whether a solution exists.",
        "Enumerate all solutions if the problem is small, or try another covering vector.",
    ),
    Status.INFEASIBLE: (
        "No point satisfies even the inequalities or the equations: a checked certificate says so.",
        "Change the problem: less friction, another load, a contact that may open.",
    ),
    Status.MAX_STEPS: (
        "The step budget ran out before the residual was small.",
        "Raise the budget, or use a pivoting method; the last iterate is in `attempt`.",
    ),
    Status.INACCURATE: (
        "The method stopped, but the recomputed residual is too large.",
        "Use float64, or another method; the rejected value is in `attempt`.",
    ),
    Status.BAD_INPUT: (
        "The data contain NaN or infinity, or the answer overflows the number format.",
        "Check the arrays of the problem; rescale if they are close to overflow.",
    ),
    Status.REDUNDANT: (
        "Solved, but only part of the answer is determined: equations or contacts depend on one another.",
        "Use the determined part (slacks, accelerations, products with the matrix), or remove the dependent contacts.",
    ),
    Status.STICKING: (
        "A frictional contact has no slip, and the sliding law says nothing there.",
        "Give the contact a slip, or make it frictionless.",
    ),
    Status.ILL_CONDITIONED: (
        "Small backward error, yet large relative to the given vector: the answer is mostly rounding.",
        "Use float64 and better units, or pass a problem farther from singular; the value is in `attempt`.",
    ),
    Status.NO_SOLUTION: (
        "Every mode was tried and none holds a solution.",
        "Change the problem; near the edge of existence repeat in float64.",
    ),
}
