"""Seconds of programs that are compared: called in turns, so that all share what the machine does meanwhile."""

import time

import numpy as np


def in_turns(calls: dict, patience: float, most: int | None = None) -> dict:
    """{name: median seconds} of calls without arguments, which have run once already.

    A call takes part until it has used `patience` seconds or was called `most` times.
    """
    times = {name: [] for name in calls}
    waiting = list(calls)
    while waiting:
        for name in waiting:
            began = time.perf_counter()
            calls[name]()
            times[name].append(time.perf_counter() - began)
        waiting = [name for name in waiting if sum(times[name]) < patience and len(times[name]) != most]
    return {name: float(np.median(t)) for name, t in times.items()}
