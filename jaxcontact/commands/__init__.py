"""What each command does."""

from .explain import add_explain
from .figures import run_figures
from .kernels import add_kernels
from .listing import run_list
from .regimes import add_regimes
from .sweeps import run_atlas, run_curve

__all__ = ["add_explain", "add_kernels", "add_regimes", "run_atlas", "run_curve", "run_figures", "run_list"]
