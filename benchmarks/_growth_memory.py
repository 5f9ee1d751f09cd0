"""Peak memory in fresh processes: how much one more configuration takes."""

import resource
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks import bounds, solvers
from jaxcontact.complementarity import LCP, PrincipalPivoting, solve

SIZES = {"sweep": (10**6, 10**7), "solve 4": (10**5, 10**6), "solve 16": (10**4, 10**5)}
"""What is computed, and for how many configurations at least and at most; quickly, for a tenth of them."""

DISTINCT = 1000
NUMBER = 8
"""Bytes of a float64."""


def measured(quick):
    """Rows: peaks for few and many configurations, and the difference per configuration beside the data that go in."""
    for what, sizes in SIZES.items():
        few, many = (size // 10 if quick else size for size in sizes)
        low, high = (peak_of(what, count) for count in (few, many))
        m = contacts(what)
        yield {
            "what": what,
            "configurations": [few, many],
            "peak bytes": [low, high],
            "bytes per configuration": (high - low) / (many - few),
            "of them data": NUMBER * (m * m + m or 1),
        }


def contacts(what):
    """The number in the name; none for a sweep, whose data are one angle per configuration."""
    return int(what.partition(" ")[2] or 0)


def peak_of(what, count):
    """Bytes at the peak of a process that does this and nothing else."""
    command = [sys.executable, "-m", __name__, what, str(count)]
    return int(subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout)


def peak():
    """Bytes at this process's peak. Linux passes a parent's peak on to `getrusage` of its children, not to VmHWM."""
    try:
        with open("/proc/self/status") as file:
            return 1024 * next(int(line.split()[1]) for line in file if line.startswith("VmHWM"))
    except OSError:
        kilobytes = sys.platform != "darwin"
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1024 if kilobytes else 1)


def sweep(count):
    """`norm_ratio` over the angle."""
    axis = np.linspace(bounds.LEAST_ANGLE, bounds.GREATEST_ANGLE, count)

    def bound(guides, theta):
        return jc.bounds.norm_ratio(jc.delassus(guides, guides.state(theta=theta)))

    return jc.sweep({"mu_max": bound}, bounds.mechanism(2), theta=axis, progress=False)


def solved(m, count):
    """Forces, statuses and residuals of a batch."""

    def answers(M, q):
        answer = solve(LCP(M, q), PrincipalPivoting())
        return answer.z, answer.status, answer.residual

    few = solvers.problems(m, DISTINCT, np.float64)
    M, q = (jnp.asarray(np.resize(part, (count, *part.shape[1:]))) for part in few)
    return jax.block_until_ready(jax.jit(jax.vmap(answers))(M, q))


def main(what, count):
    """Compute, then print the peak."""
    jax.config.update("jax_enable_x64", True)
    kept = solved(m, count) if (m := contacts(what)) else sweep(count)
    print(peak())
    del kept


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
