"""Other people's solvers of linear complementarity problems, measured where they are installed.

QuantEcon's core is compiled by numba, so a loop over the batch on all cores is compiled too. Drake and Siconos are
called once per problem from Python, as a user would: at small sizes the call itself is most of their time, and Drake's
includes the MathematicalProgram through which Python reaches its solver.
"""

import importlib.metadata
import importlib.util
import os

import numpy as np


def available() -> dict:
    """{name with version and manner of calling: function (M (b, m, m), q (b, m)) -> (z (b, m), solved (b,))}"""
    peers = {}
    if importlib.util.find_spec("quantecon"):
        name = f"quantecon {importlib.metadata.version('quantecon')}, numba loop"
        peers[name] = _quantecon()
    if importlib.util.find_spec("pydrake"):
        name = f"drake {importlib.metadata.version('drake')} Moby, call by call"
        peers[name] = _drake()
    if importlib.util.find_spec("siconos"):
        import siconos

        peers[f"siconos {getattr(siconos, '__version__', '')} Lemke, call by call"] = _siconos()
    return peers


def _quantecon():
    # threads that wait by spinning would take a core from whoever is measured next
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    import numba
    from quantecon.optimize import lcp_lemke

    numba.set_num_threads(min(os.cpu_count(), numba.config.NUMBA_NUM_THREADS))

    @numba.njit(parallel=True)
    def loop(M, q):
        z, solved = np.empty_like(q), np.empty(len(q), np.bool_)
        for i in numba.prange(len(q)):
            result = lcp_lemke(M[i], q[i])
            z[i] = result.z
            solved[i] = result.success
        return z, solved

    return loop


def _drake():
    from pydrake.solvers import MathematicalProgram, MobyLcpSolver

    solver = MobyLcpSolver()

    def loop(M, q):
        z, solved = np.empty_like(q), np.empty(len(q), bool)
        for i in range(len(q)):
            program = MathematicalProgram()
            unknown = program.NewContinuousVariables(len(q[i]))
            program.AddLinearComplementarityConstraint(M[i], q[i], unknown)
            result = solver.Solve(program)
            z[i], solved[i] = result.GetSolution(unknown), result.is_success()
        return z, solved

    return loop


def _siconos():
    import siconos.numerics as numerics

    def loop(M, q):
        z, solved = np.zeros_like(q), np.empty(len(q), bool)
        options = numerics.SolverOptions(numerics.SICONOS_LCP_LEMKE)
        for i in range(len(q)):
            w = np.zeros_like(q[i])
            solved[i] = numerics.linearComplementarity_driver(numerics.LCP(M[i], q[i]), z[i], w, options) == 0
        return z, solved

    return loop
