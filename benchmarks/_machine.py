"""On what a measurement was made."""

import os
import platform
from datetime import UTC, datetime

import jax
import jaxlib

from jaxcontact import native


def machine() -> dict:
    """Processor, cores this process may use, their load, versions, date: the line that goes with every measurement."""
    return {
        "processor": processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "load average at start": round(os.getloadavg()[0], 2),
        "device": jax.devices()[0].device_kind,
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
        "jax": jax.__version__,
        "jaxlib": jaxlib.__version__,
        "compiled kernels": native.reason() or "in use",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def processor() -> str:
    """The processor as the system names it."""
    try:
        with open("/proc/cpuinfo") as file:
            names = [line.partition(":")[2].strip() for line in file if line.startswith("model name")]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or platform.machine()
