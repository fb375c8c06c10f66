"""Gymnasium adapters; ``import pace_drake`` registers them."""
