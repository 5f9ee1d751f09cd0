"""`jaxcontact figures --out DIR`."""

import argparse
import time


def run_figures(given: argparse.Namespace) -> None:
    """Write the figures, naming each file as it is done."""
    # The figures need the extra `plot`, which the other commands can do without.
    from ..figures import write_figures

    started = time.perf_counter()
    written = 0
    for path in write_figures(given.out):
        print(path, flush=True)
        written += 1
    print(f"{written} files in {time.perf_counter() - started:.1f} s")
