"""Losses, their gradients, and the views that are learnt from."""
