"""Seconds of programs that are compared: called in turns, so that all share what the machine does meanwhile."""

import time

import numpy as np


def in_turns(calls: dict, patience: float, most: int | None = None) -> dict:
    """{name: median seconds} of calls without arguments, which have run once already.

    A call takes part until it has used `patience` seconds or was called `most` times. Each round has an order of its
    own, so that none always follows the same other: threads of a loop that is over may still wait for work.
    """
    times = {name: [] for name in calls}
    waiting, rng = list(calls), np.random.default_rng(0)
    while waiting:
        for name in rng.permutation(waiting).tolist():
            began = time.perf_counter()
            calls[name]()
            times[name].append(time.perf_counter() - began)
        waiting = [name for name in waiting if sum(times[name]) < patience and len(times[name]) != most]
    return {name: float(np.median(t)) for name, t in times.items()}
