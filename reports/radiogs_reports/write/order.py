"""Measured and published order of the methods as CSV."""

import pandas as pd

from ..analysis.published_order import OrderReport


def order_csv(report: OrderReport) -> str:
    """One record per column: tau with the ends of its interval, and the pairs of rows in the other order."""
    records = [
        {
            "column": order.column["key"], "methods": order.methods, "pairs": order.pairs, "tau": order.tau,
            "tau_low": order.low, "tau_high": order.high, "by_chance": order.by_chance,
            "reversed": "; ".join(f"{each.better} > {each.worse}" for each in order.reversals) or None,
        }
        for order in report.orders
    ]  # fmt: skip
    return pd.DataFrame.from_records(records).to_csv(index=False)
