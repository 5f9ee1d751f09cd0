"""Friction bounds, certificates and batched contact solving for mechanisms, in JAX."""
