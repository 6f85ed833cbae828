"""K3: the BRDF, the Monte-Carlo sum of Eq. 8, and the split sum."""
