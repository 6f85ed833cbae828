"""What leaving an effect out would change, and what it costs: radiance under a plan, image errors, gradients, work."""
