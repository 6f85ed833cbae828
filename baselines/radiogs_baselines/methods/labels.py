"""Texts of labels that several methods share; a label states how a run differs from the published method."""


def length(share: float | None, extent: float, published: str, otherwise: str) -> str:
    """A length that a variant gives as a share of the scene's extent (world units), beside the published one.

    ``otherwise``: the text if the variant gives none.
    """
    own = otherwise if share is None else f"{share * extent:.3g} world units"
    return f"{own} (published: {published})"
