"""A suite of one's own with every field that a file may have."""

WHOLE = """
name = "mine"
title = "Mine & yours"
published = "ablation"
reference = "a"
columns = ["nvs/psnr", "normal/mae"]
scenes = ["corner", "elsewhere/scene"]

[[rows]]
key = "a"
text = "50 % of #1"

[[rows]]
key = "b"
text = "b"
latex = "$b$"
variant = { radiometric_weight = 1, detach = "pbr", view_share = 0.5 }
budget = { incident_samples = 0.5 }
settings = { spacing = 0.1 }
"""
