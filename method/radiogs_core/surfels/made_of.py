"""What a trained model offers that is made of surfels; the harness looks whether it does."""

from typing import Protocol, runtime_checkable

from .surfels import Surfels


@runtime_checkable
class MadeOfSurfels(Protocol):
    """A trained model that can be shown in 3-D, as the surfels that it exports."""

    @property
    def surfels(self) -> Surfels:
        """Its surfels, with the materials that other programs get."""
