"""Any quantity over any grid: chunked, labelled, stored, drawn."""

from .sweep import sweep

__all__ = ["sweep"]
