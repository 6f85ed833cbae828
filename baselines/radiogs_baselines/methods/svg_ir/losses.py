"""SVG-IR's own loss: materials are fitted to the radiance that is kept."""

from jaxtyping import Float, Int
from torch import Tensor

from .model import Model
from .shading import materials_of, mirrored, one_bounce
from .table import Table


def radiance_consistency(
    model: Model,
    table: Table,
    index: Int[Tensor, " chosen"],
    eye: Float[Tensor, "3"],
    environment: Float[Tensor, "rows columns 3"],
    distance: float,
) -> Float[Tensor, ""]:
    """Mean L1, over ``index``, between one bounce at a ray's first hit and the ray's kept radiance times the ratio.

    One ray a surfel, see ``mirrored``; a surfel without one counts as zero. Gradient to the materials of what is met,
    seen by a camera or not, to ``environment`` and to the ratio.
    """
    surfel, sample = mirrored(table, model.surfels, index, eye)
    if not len(surfel):
        return environment.new_zeros(())
    bounce = one_bounce(materials_of(model, model.albedo), table, surfel, sample, environment, distance)
    kept = model.ratio * table.radiance[surfel, sample]
    return (bounce - kept).abs().sum() / (3 * len(index))
