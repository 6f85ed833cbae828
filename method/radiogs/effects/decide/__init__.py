"""Which effects are left out: evidence against a tolerance, before and during training."""
