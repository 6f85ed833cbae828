"""What leaving an effect out would change, and what it costs: candidates, images, gradients, prices."""
