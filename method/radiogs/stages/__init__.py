"""The two training stages: initialisation (split-sum) and inverse rendering (Monte-Carlo consistency)."""
