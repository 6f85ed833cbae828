"""Features of materials that the paper's BRDF (albedo, roughness, F0 = 0.04) cannot express."""

FEATURES = ("metallic", "transmission", "transparent", "subsurface", "coat", "sheen", "anisotropic", "other_specular",
            "no_specular", "rough_diffuse", "normal_map", "emissive", "displacement", "volume")  # fmt: skip
"""Names of the outputs (AOVs) that hold the weight of each feature."""

WEIGHTS = {
    "metallic": "Metallic", "transmission": "Transmission Weight", "subsurface": "Subsurface Weight",
    "coat": "Coat Weight", "sheen": "Sheen Weight", "anisotropic": "Anisotropic",
    "rough_diffuse": "Diffuse Roughness",
}  # fmt: skip
"""Features of a Principled BSDF by the name of the input that is their weight."""
