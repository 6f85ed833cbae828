"""Who is first, second and third in a column: of the figures as printed, so that equal print has equal rank."""

from ..summary import ColumnSummary, Summary


def ranks(summary: Summary, column: ColumnSummary) -> dict[str, int]:
    """Rank from 1 by row key, for rows that have the figure; ties share the better rank.

    None where no row is the reference: the rows are no variants of one thing, and race nobody.
    """
    if summary["reference"] is None:
        return {}
    cells = {row["key"]: summary["cells"][row["key"]][column["key"]]["mean"] for row in summary["rows"]}
    printed = {key: round(mean, column["decimals"]) for key, mean in cells.items() if mean is not None}
    worth = abs if column["direction"] == "zero" else float
    order = sorted(set(printed.values()), key=worth, reverse=column["direction"] == "up")
    return {key: order.index(value) + 1 for key, value in printed.items()}
