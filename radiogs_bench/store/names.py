"""Names that come from stored files and become parts of paths."""

import re

from radiogs_core.errors import DataError

PLAIN = re.compile(r"(?!\.)[\w.-]{1,120}")
"""Letters, digits, dots, dashes and underscores, no dot first: neither a path nor the folder above."""


def plain_name(name: object, origin: str) -> str:
    """The name, if it is a plain file name. Raises DataError, which says where it stands (``origin``)."""
    if isinstance(name, str) and PLAIN.fullmatch(name) is not None:
        return name
    raise DataError(
        f"{origin} is no plain file name: {name!r:.200}",
        "Names from stored files become names of files; this one could lead out of the folder.",
        "Do not use this file unless you know who made it; a run of your own writes plain names.",
    )
