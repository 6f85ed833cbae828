"""What is wrong with a file, for whoever asked from outside."""


class Unusable(Exception):
    """The file cannot be rendered: what, why, and what to do next."""

    def __init__(self, what: str, why: str, remedy: str) -> None:
        super().__init__(what)
        self.told = {"what": what, "why": why, "remedy": remedy}
