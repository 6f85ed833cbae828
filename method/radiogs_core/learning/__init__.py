"""Losses, their gradients, training views, and the stages that learn geometry, light and radiance."""
