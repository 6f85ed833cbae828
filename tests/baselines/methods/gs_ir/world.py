"""A floor under a roof, the lattice that occlusion is baked on, and trained models of such sheets."""

from typing import Any

import numpy as np
import torch
from numpy.polynomial import legendre

from baselines.methods.irgs.world import DOWN, grey, sheet
from known_ball import CPU, SCENE
from radiogs_baselines.methods.gs_ir.model import Model
from radiogs_baselines.methods.gs_ir.settings import PRESETS, Variant
from radiogs_baselines.methods.gs_ir.showing import TrainedGSIR
from radiogs_baselines.methods.gs_ir.training import Reach, bake
from radiogs_baselines.methods.gs_ir.volumes import IrradianceVolume, Lattice, OcclusionVolume
from radiogs_core.contract import Run
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.harmonics import CONSTANT_BASIS
from radiogs_core.surfels.surfels import Surfels

TAU = 0.5
"""Distance from which on geometry does not occlude, world units."""

LATTICE = Lattice(torch.full((3,), -0.7), 1.4, 8)
"""Corners 0.2 apart; the ones nearest to the floor at height 0 lie 0.1 above and below it."""

PROBE = 0.1
"""Height of the probes that the floor reads: half a cell in front of it, only these are ahead."""

UPWARDS = torch.tensor([[0.0, 0.0, 1.0]])


def roof(height: float, opacity: float = 0.9999, albedo: float = 0.5) -> Surfels:
    """A sheet that faces down to the floor, practically infinite as seen from it."""
    return sheet(height, DOWN, scale=1e4 * max(1.0, height), opacity=opacity, albedo=albedo)


def baked(surfels: Surfels, reach: Reach | None = None, directions: int = 4096) -> OcclusionVolume:
    """Occlusion baked on ``LATTICE``; occluders count up to TAU unless ``reach`` is given."""
    return bake(surfels, LATTICE, reach or Reach(tau=TAU), directions)


def openness(volume: OcclusionVolume, samples: int = 4096) -> float:
    """O of the floor at the origin."""
    return float(volume.openness(torch.zeros(1, 3), UPWARDS, samples))


def closed_form(
    height: float | None, tau: float = TAU, nearest: float = 0.0, directions: int = 200_001, samples: int = 20_001
) -> float:
    """O of the floor from the formulas: M of a probe between floor and roof by Legendre polynomials.

    The probe sees the floor at a distance of PROBE / -cosine and the roof at (height - PROBE) / cosine.
    """
    cosine = np.linspace(-1, 1, directions)
    with np.errstate(divide="ignore"):
        floor = np.where(cosine < 0, PROBE / -cosine, np.inf)
        above = np.inf if height is None else np.where(cosine > 0, (height - PROBE) / cosine, np.inf)
    distance = np.minimum(floor, above)
    mask = 1.0 - ((distance >= nearest) & (distance < tau))
    each = [np.trapezoid(mask * legendre.Legendre.basis(degree)(cosine), cosine) for degree in range(4)]
    kept = legendre.Legendre([(2 * degree + 1) / 2 * value for degree, value in enumerate(each)])
    about = np.linspace(0, 1, samples)
    return float(np.trapezoid(2 * about * kept(about).clip(0, 1), about))


def lit(level: float, lattice: Lattice = LATTICE) -> IrradianceVolume:
    """A volume of constant irradiance over pi ``level``, for all positions and normals."""
    volume = IrradianceVolume.dark(lattice.of(5))
    volume.coefficients[:, 0] = level / CONSTANT_BASIS
    return volume


def model_of(surfels: Surfels, light: EnvironmentMap | None = None, **volumes: Any) -> Model:
    """A model with these surfels and volumes, without training."""
    return Model(surfels, (light or grey()).radiance.to(surfels.centre).log(), **volumes)


def trained(model: Model, **turned: Any) -> TrainedGSIR:
    """``model_of`` with a run; ``turned``: changed fields of the variant."""
    return TrainedGSIR(model, Run(SCENE, Variant(**turned), PRESETS["smoke"], 0, CPU))
