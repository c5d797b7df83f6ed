"""Environments that are known: their rewards in torch."""
