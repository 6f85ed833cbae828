"""The sum of direct and gathered light as an image."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

from radiogs_core.kernels.image.display import displayed

from .variant import Sum


def median(image: Float[Tensor, "height width channels"]) -> Float[Tensor, "height width channels"]:
    """The median of each pixel and its eight neighbours, channel by channel; beyond the border is black."""
    padded = pad(image, (0, 0, 1, 1, 1, 1))
    height, width = image.shape[:2]
    around = [padded[row : row + height, column : column + width] for row in range(3) for column in range(3)]
    return torch.stack(around).median(0).values


def summed(
    direct: Float[Tensor, "height width 3"],
    indirect: Float[Tensor, "height width 3"],
    alpha: Float[Tensor, "height width"],
    where: Sum,
    straight: bool,
) -> Float[Tensor, "height width 3"]:
    """The display-sRGB image on black of two linear radiances, both multiplied by coverage; not clipped.

    ``where`` "display", as published: sRGB(direct) + sRGB(indirect), which is more than sRGB(direct + indirect).
    ``straight``: see ``splatting.displayed``.
    """
    if where == "linear":
        return displayed(direct + indirect, alpha, straight)
    return displayed(direct, alpha, straight) + displayed(indirect, alpha, straight)
